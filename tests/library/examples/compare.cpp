// SPDX-License-Identifier: Apache-2.0
// Compares a field with the photographs of a session that it was not estimated from.
#include "refield/compare.h"

#include <cstdio>

int main(int, char** arguments) {
  for (const refield::HeldOutError& error :
       refield::compare(refield::Field(arguments[1]), refield::Session(arguments[2])))
    std::printf("%s: relative RMSE %.4f, median pixel %.4f\n", error.kind.c_str(), error.relative_rmse,
                error.median);
}
