// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/chart/row.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <sstream>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/number_text.h"

namespace refield::chart {

namespace {

constexpr const char* first_columns =
    "method,setting,images,seconds,relight_ms,bytes_per_pixel,functions_per_pixel";
constexpr std::size_t first_column_count = 7;

/// Six significant digits, whatever the locale; empty for what is not known.
std::string number(double value) {
  if (std::isnan(value)) return "";
  char buffer[64];
  return {buffer, std::to_chars(buffer, buffer + sizeof buffer, value, std::chars_format::general, 6).ptr};
}

std::string header(const std::vector<std::string>& names) {
  std::string line = first_columns;
  for (const std::string& name : names) line += "," + name;
  return line;
}

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells(1);
  for (const char c : line)
    if (c == ',')
      cells.emplace_back();
    else
      cells.back() += c;
  return cells;
}

double value_of(const std::string& cell, const std::filesystem::path& path) {
  if (cell.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto value = number_from_text<double>(cell);
  if (!value)
    throw FormatError(path, "'" + cell + "' is no number; delete the file, or run without --resume");
  return *value;
}

}  // namespace

std::vector<std::string> error_names(const ChartData& data) {
  std::vector<std::string> names;
  for (const std::string& light : data.light_kinds) {
    names.push_back(light);
    names.push_back(light + "_median");
    names.push_back(light + "_p90");
    if (!data.pixel_kinds) continue;
    for (const std::string& kind : data.pixel_kinds->names) {
      names.push_back(light + "_" + kind);
      names.push_back(light + "_" + kind + "_median");
    }
  }
  return names;
}

double error_of(const ChartRow& row, const std::vector<std::string>& names, const std::string& name) {
  const auto found = std::ranges::find(names, name);
  if (found == names.end()) return std::numeric_limits<double>::quiet_NaN();
  return row.errors[static_cast<std::size_t>(found - names.begin())];
}

std::string csv_of(const std::vector<ChartRow>& rows, const std::vector<std::string>& names) {
  std::string text = header(names) + "\n";
  for (const ChartRow& row : rows) {
    text += row.method + "," + row.setting + "," + std::to_string(row.images) + "," + number(row.seconds) +
            "," + number(row.relight_ms) + "," + number(row.bytes_per_pixel) + "," +
            number(row.functions_per_pixel);
    for (const double error : row.errors) text += "," + number(error);
    text += "\n";
  }
  return text;
}

std::vector<ChartRow> rows_of_csv(const std::filesystem::path& path, const std::vector<std::string>& names) {
  std::istringstream text(read_text(path));
  std::string line;
  std::getline(text, line);
  if (line != header(names)) return {};
  std::vector<ChartRow> rows;
  while (std::getline(text, line)) {
    const auto cells = cells_of(line);
    if (cells.size() != first_column_count + names.size())
      throw FormatError(path, "a row is cut short; delete the file, or run without --resume");
    ChartRow& row = rows.emplace_back();
    row.method = cells[0];
    row.setting = cells[1];
    row.images = static_cast<int>(value_of(cells[2], path));
    row.seconds = value_of(cells[3], path);
    row.relight_ms = value_of(cells[4], path);
    row.bytes_per_pixel = value_of(cells[5], path);
    row.functions_per_pixel = value_of(cells[6], path);
    for (std::size_t k = first_column_count; k < cells.size(); ++k)
      row.errors.push_back(value_of(cells[k], path));
  }
  return rows;
}

}  // namespace refield::chart
