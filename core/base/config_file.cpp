// SPDX-License-Identifier: Apache-2.0
#include "core/base/config_file.h"

#define TOML_EXCEPTIONS 1
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <sstream>

#include "core/base/files.h"

namespace refield {

namespace {

std::string text_of(const toml::node& node) {
  std::ostringstream text;
  node.visit([&](const auto& value) {
    if constexpr (toml::is_floating_point<decltype(value)>)
      text << *value;  // the library itself writes 2.2 as 2.2000000000000002
    else
      text << value;
  });
  constexpr std::size_t max_length = 100;  // lists can hold thousands of numbers
  return text.str().size() <= max_length ? text.str() : text.str().substr(0, max_length) + " ...";
}

std::string range_text(double low, double high) {
  std::ostringstream text;
  if (high < ConfigSection::unlimited)
    text << "from " << low << " to " << high;
  else if (low > -1e6)
    text << "of at least " << low;
  else
    text << "of finite size";
  return text.str();
}

const toml::table& table_of(const void* table) {
  return *static_cast<const toml::table*>(table);
}

std::string place(const fs::path& path, const toml::node& node) {
  const auto& source = node.source();  // its file is another one where a base added the node
  return (source.path ? *source.path : path.string()) + ":" + std::to_string(node.source().begin.line) + ": ";
}

/// Levenshtein's distance: letters to insert, leave out or replace.
std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i - 1] != b[j - 1]);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, replaced});
    }
  }
  return row[b.size()];
}

}  // namespace

std::string unknown_name_text(const std::string& name, const std::vector<std::string>& known) {
  std::string text = "is not a known key", names;
  constexpr std::size_t max_length = 100;  // of a name that may be misspelt
  const auto distance = [&](const std::string& other) { return edit_distance(name, other); };
  if (!known.empty() && name.size() <= max_length) {
    const std::string& nearest = *std::ranges::min_element(known, {}, distance);
    if (distance(nearest) <= 1 + nearest.size() / 4) text += "; did you mean '" + nearest + "'?";
  }
  for (const std::string& other : known) names += (names.empty() ? "" : ", ") + other;
  return text + (text.ends_with('?') ? " Known" : "; known") + " are " + names;
}

void ConfigSection::fail(const std::string& key, const std::string& what) const {
  const toml::table& table = table_of(table_);
  const toml::node* node = table.get(key);
  throw InputError(place(*file_, node ? *node : table), name_.empty() ? "" : "[" + name_ + "] ", key,
                   node ? " = " + text_of(*node) : std::string(), ": ", what);
}

bool ConfigSection::has(const std::string& key) const {
  return table_of(table_).contains(key);
}

void ConfigSection::require(const std::string& key) const {
  if (!has(key)) fail(key, "is missing; add it");
}

void ConfigSection::number(const std::string& key, double& value, double low, double high) {
  known_.insert(key);
  if (!has(key)) return;
  const auto read = table_of(table_).get(key)->value<double>();
  if (!read || !(*read >= low && *read <= high)) fail(key, "give a number " + range_text(low, high));
  value = *read;
}

void ConfigSection::integer(const std::string& key, int& value, int low, int high) {
  known_.insert(key);
  if (!has(key)) return;
  const auto read = table_of(table_).get(key)->value_exact<std::int64_t>();
  if (!read || *read < low || *read > high) fail(key, "give a whole number " + range_text(low, high));
  value = static_cast<int>(*read);
}

void ConfigSection::flag(const std::string& key, bool& value) {
  known_.insert(key);
  if (!has(key)) return;
  const auto read = table_of(table_).get(key)->value_exact<bool>();
  if (!read) fail(key, "give true or false");
  value = *read;
}

void ConfigSection::text(const std::string& key, std::string& value, bool may_be_empty) {
  known_.insert(key);
  if (!has(key)) return;
  const auto read = table_of(table_).get(key)->value_exact<std::string>();
  const bool is_text = read && read->find('\0') == std::string::npos;  // paths end at a zero
  if (!is_text || (read->empty() && !may_be_empty)) fail(key, "give a string in quotes");
  value = *read;
}

void ConfigSection::numbers(const std::string& key, std::vector<double>& value, double low, double high) {
  known_.insert(key);
  if (!has(key)) return;
  const std::string remedy =
      "give numbers " + range_text(low, high) + " in brackets, for example [0.1, 0.2, 0.3]";
  const toml::array* array = table_of(table_).get(key)->as_array();
  if (!array) fail(key, remedy);
  value.clear();
  for (const toml::node& element : *array) {
    const auto read = element.value<double>();
    if (!read || !(*read >= low && *read <= high)) fail(key, remedy);
    value.push_back(*read);
  }
}

void ConfigSection::triple(const std::string& key, std::array<double, 3>& value, double low, double high) {
  std::vector<double> read(value.begin(), value.end());
  numbers(key, read, low, high);
  if (read.size() != 3) fail(key, "give three numbers, for example [0.1, 0.2, 0.3]");
  std::ranges::copy(read, value.begin());
}

void ConfigSection::vector(const std::string& key, Eigen::Vector3d& value, double low, double high) {
  std::array<double, 3> v{value.x(), value.y(), value.z()};
  triple(key, v, low, high);
  value = {v[0], v[1], v[2]};
}

void ConfigSection::integers(const std::string& key, std::vector<int>& value, int low, int high) {
  std::vector<double> read(value.begin(), value.end());
  numbers(key, read, low, high);
  if (read.size() != value.size()) fail(key, "give " + std::to_string(value.size()) + " whole numbers");
  for (std::size_t i = 0; i < value.size(); ++i) {
    if (read[i] != std::floor(read[i])) fail(key, "give whole numbers");
    value[i] = static_cast<int>(read[i]);
  }
}

std::vector<std::vector<double>> ConfigSection::rows(const std::string& key, std::size_t width,
                                                     const char* remedy) {
  known_.insert(key);
  const toml::array* array = has(key) ? table_of(table_).get(key)->as_array() : nullptr;
  if (!array) fail(key, remedy);
  std::vector<std::vector<double>> rows;
  for (const toml::node& element : *array) {
    const toml::array* row = element.as_array();
    if (!row || row->size() != width) fail(key, remedy);
    std::vector<double>& numbers = rows.emplace_back();
    for (const toml::node& node : *row) {
      const auto number = node.value<double>();
      if (!number || !(std::abs(*number) <= 1e6)) fail(key, remedy);
      numbers.push_back(*number);
    }
  }
  return rows;
}

void ConfigSection::pairs(const std::string& key, std::vector<Eigen::Vector2d>& value) {
  known_.insert(key);
  if (!has(key)) return;
  const char* remedy = "give at least two pairs [radius, height] with radius ≥ 0, from one end to the other";
  const auto found = rows(key, 2, remedy);
  if (found.size() < 2) fail(key, remedy);
  value.clear();
  for (const auto& pair : found) {
    if (pair[0] < 0.0) fail(key, remedy);
    value.emplace_back(pair[0], pair[1]);
  }
}

void ConfigSection::seconds(const std::string& key, Seconds& value, Seconds unit, double low, double high) {
  double number_of_units = value / unit;
  number(key, number_of_units, low, high);
  if (has(key)) value = number_of_units * unit;
}

std::string ConfigSection::path_of(const std::string& key) const {
  return name_.empty() ? key : name_ + "." + key;
}

std::optional<ConfigSection> ConfigSection::table(const std::string& key) {
  known_.insert(key);
  if (!has(key)) return std::nullopt;
  const std::string name = path_of(key);
  if (const toml::table* found = table_of(table_).get(key)->as_table())
    return ConfigSection(*file_, name, found);
  fail(key, "give a table, [" + name + "]");
}

std::vector<ConfigSection> ConfigSection::tables(const std::string& key) {
  known_.insert(key);
  if (!has(key)) return {};
  const std::string name = path_of(key);
  if (!table_of(table_).get(key)->is_array_of_tables()) fail(key, "give tables, [[" + name + "]]");
  std::vector<ConfigSection> result;
  for (const toml::node& node : *table_of(table_).get(key)->as_array())
    result.push_back({*file_, name, node.as_table()});
  return result;
}

std::map<std::string, std::int64_t> ConfigSection::settings() {
  std::map<std::string, std::int64_t> result;
  for (const auto& [key, node] : table_of(table_)) {
    const std::string name(key.str());
    known_.insert(name);
    const auto flag_value = node.value_exact<bool>();
    const auto read =
        flag_value ? std::optional<std::int64_t>(*flag_value) : node.value_exact<std::int64_t>();
    if (!read) fail(name, "give a whole number, or true or false");
    result[name] = *read;
  }
  return result;
}

std::map<std::string, std::string> ConfigSection::texts() {
  std::map<std::string, std::string> result;
  for (const auto& [key, node] : table_of(table_)) {
    const std::string name(key.str());
    known_.insert(name);
    if (const auto text = node.value_exact<std::string>())
      result[name] = *text;
    else if (const auto flag_value = node.value_exact<bool>())
      result[name] = *flag_value ? "true" : "false";
    else if (const auto whole = node.value_exact<std::int64_t>())
      result[name] = std::to_string(*whole);
    else if (const auto number_value = node.value_exact<double>())
      result[name] = (std::ostringstream() << std::setprecision(12) << *number_value).str();
    else
      fail(name, "give a text, a number, or true or false");
  }
  return result;
}

void ConfigSection::finish() const {
  for (const auto& [key, node] : table_of(table_)) {
    if (known_.contains(std::string(key.str()))) continue;
    const std::string name(key.str());
    fail(name, unknown_name_text(name, {known_.begin(), known_.end()}));
  }
}

struct ConfigFile::Content {
  toml::table root;
  toml::table none;
};

ConfigFile::ConfigFile(fs::path path, std::string what, std::string manual)
    : path_(std::move(path)),
      what_(std::move(what)),
      manual_(std::move(manual)),
      content_(std::make_unique<Content>()) {
  if (!fs::is_regular_file(path_))
    throw InputError(path_, ": there is no such ", what_, "; give a TOML file, ", manual_, " describes it");
  try {
    content_->root = toml::parse(read_text(path_), path_.string());
  } catch (const toml::parse_error& error) {
    throw InputError(path_, ":", error.source().begin.line, ": is not valid TOML: ", error.description());
  }
}

ConfigFile::~ConfigFile() = default;

namespace {

/// Moves what `table` lacks from `base`; a copy would not know its line.
void add_missing(toml::table& table, toml::table& base) {
  for (auto&& [key, node] : base) {
    toml::node* mine = table.get(key.str());
    if (!mine)
      node.visit([&, name = key.str()](auto& value) { table.insert(name, std::move(value)); });
    else if (mine->is_table() && node.is_table())
      add_missing(*mine->as_table(), *node.as_table());
  }
}

}  // namespace

fs::path ConfigFile::add_base() {
  if (!has("base")) return {};
  std::string name;
  root().text("base", name);
  content_->root.erase("base");
  ConfigFile base(path_.parent_path() / name, what_, manual_);
  add_missing(content_->root, base.content_->root);
  return base.path_;
}

void ConfigFile::check_names(std::initializer_list<const char*> known) const {
  for (const auto& [key, node] : content_->root) {
    const std::string name(key.str());
    if (std::ranges::find(known, name) == known.end())
      throw InputError(place(path_, node), "'", name, "' ",
                       unknown_name_text(name, {known.begin(), known.end()}));
  }
}

bool ConfigFile::has(const std::string& name) const {
  return content_->root.contains(name);
}

ConfigSection ConfigFile::root() const {
  return {path_, "", &content_->root};
}

ConfigSection ConfigFile::section(const std::string& name) const {
  if (const toml::table* table = content_->root[name].as_table()) return {path_, name, table};
  throw InputError(path_, ": lacks the table [", name, "]; ", manual_, " describes a ", what_);
}

ConfigSection ConfigFile::optional_section(const std::string& name) const {
  return has(name) ? section(name) : ConfigSection(path_, name, &content_->none);
}

std::vector<ConfigSection> ConfigFile::sections(const std::string& name) const {
  const toml::array* array = content_->root[name].as_array();
  if (!array || array->empty() || !array->is_array_of_tables())
    throw InputError(path_, ": lacks any [[", name, "]]; ", manual_, " describes a ", what_);
  std::vector<ConfigSection> result;
  for (const toml::node& node : *array) result.push_back({path_, name, node.as_table()});
  return result;
}

void ConfigFile::whole_number(const std::string& key, std::uint64_t& value) const {
  const toml::node* node = content_->root.get(key);
  if (!node) return;
  const auto read = node->value_exact<std::int64_t>();
  if (!read || *read < 0)
    throw InputError(place(path_, *node), key, " = ", text_of(*node), ": give a whole number of at least 0");
  value = static_cast<std::uint64_t>(*read);
}

}  // namespace refield
