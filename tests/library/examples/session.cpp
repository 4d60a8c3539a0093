// SPDX-License-Identifier: Apache-2.0
// Lists the frames of a capture session and shows how bright each photograph is.
#include "refield/session.h"

#include <cstdio>
#include <numeric>

int main(int, char** arguments) {
  const refield::Session session(arguments[1]);
  for (std::size_t i = 0; i < session.size(); ++i) {
    const refield::SessionFrame frame = session.frame(i);
    const std::vector<float> values = session.observed(i).radiance.values;
    const double mean =
        std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
    std::printf("%s, %s: %.4f\n", frame.name.c_str(), frame.kind.c_str(), mean);
  }
}
