// SPDX-License-Identifier: Apache-2.0
// Estimates a reflectance field from the photographs of a session into a file, band by band.
#include "refield/estimate.h"

#include <cstdio>

int main(int, char** arguments) {
  const refield::Session session(arguments[1]);
  refield::EstimateOptions options;
  options.memory_bytes = 1ull << 30;
  const refield::EstimateReport report = refield::estimate_to_file(session, options, arguments[2]);
  std::printf("%d images, training error %.4f\n%s", report.plan.images, report.median_training_error,
              report.verdict.c_str());
}
