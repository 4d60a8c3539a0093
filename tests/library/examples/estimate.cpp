// SPDX-License-Identifier: Apache-2.0
// Estimates a reflectance field from the photographs of a session and writes it.
#include "refield/estimate.h"

int main(int, char** arguments) {
  const refield::Session session(arguments[1]);
  refield::EstimateOptions options;
  options.memory_bytes = 1ull << 30;
  refield::estimate(session, options).write(arguments[2]);
}
