// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <initializer_list>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/errors.h"
#include "core/base/units.h"

namespace refield {

/// What to say of a name that is not one of `known`: which of them is meant, by its spelling, and all of
/// them.
std::string unknown_name_text(const std::string& name, const std::vector<std::string>& known);

/// One table of a TOML file that a person may have written. Values that are absent leave what they are read
/// into as it is. Every error names file, line, table, key, value and remedy; keys that no one asked for are
/// errors, too. All functions throw InputError.
class ConfigSection {
 public:
  static constexpr double unlimited = std::numeric_limits<double>::max();

  /// "recipe.toml:12: [camera] width = -3: what"
  [[noreturn]] void fail(const std::string& key, const std::string& what) const;
  bool has(const std::string& key) const;
  void require(const std::string& key) const;

  void number(const std::string& key, double& value, double low, double high);
  void integer(const std::string& key, int& value, int low, int high);
  void flag(const std::string& key, bool& value);
  /// `may_be_empty`: accepts "".
  void text(const std::string& key, std::string& value, bool may_be_empty = false);
  /// Three numbers.
  void triple(const std::string& key, std::array<double, 3>& value, double low, double high);
  void vector(const std::string& key, Eigen::Vector3d& value, double low = -1e6, double high = 1e6);
  /// Pairs of numbers, at least two, the first not negative.
  void pairs(const std::string& key, std::vector<Eigen::Vector2d>& value);
  /// Any number of rows of `width` numbers; absent or of another form is an error that tells the remedy.
  std::vector<std::vector<double>> rows(const std::string& key, std::size_t width, const char* remedy);
  /// Any number of numbers.
  void numbers(const std::string& key, std::vector<double>& value, double low, double high);
  /// Exactly as many whole numbers as `value` has.
  void integers(const std::string& key, std::vector<int>& value, int low, int high);
  /// Seconds from a number in units of `unit`.
  void seconds(const std::string& key, Seconds& value, Seconds unit, double low, double high);
  /// The table under `key`, if there is one.
  std::optional<ConfigSection> table(const std::string& key);
  /// The array of tables under `key`; empty where there is none.
  std::vector<ConfigSection> tables(const std::string& key);
  /// All keys of the table, each a whole number or true or false.
  std::map<std::string, std::int64_t> settings();
  /// All keys of the table as text, each a text, a number, or true or false.
  std::map<std::string, std::string> texts();

  template <class Value>
  void choice(const std::string& key, Value& value,
              std::initializer_list<std::pair<std::string_view, Value>> choices) {
    std::string name, names;
    text(key, name);
    if (name.empty()) return;
    for (const auto& [choice_name, choice_value] : choices) {
      if (name == choice_name) {
        value = choice_value;
        return;
      }
      names += (names.empty() ? "" : ", ") + std::string(choice_name);
    }
    fail(key, "use one of " + names);
  }
  /// One of `values`, by its name_of().
  template <class Value, class... Values>
  void enumerator(const std::string& key, Value& value, Values... values) {
    choice<Value>(key, value, {{name_of(values), values}...});
  }

  /// Throws when the table holds a key that was not read.
  void finish() const;

 private:
  friend class ConfigFile;
  ConfigSection(const fs::path& file, std::string name, const void* table)
      : file_(&file), name_(std::move(name)), table_(table) {}
  std::string path_of(const std::string& key) const;
  const fs::path* file_;
  std::string name_;
  const void* table_;  // the TOML library's
  std::set<std::string> known_;
};

/// A TOML file that a person may have written. Sections refer to it and must not outlive it.
class ConfigFile {
 public:
  /// `what` ("recipe", "rig file") names the kind in messages, `manual` the page that describes it.
  /// Throws InputError for a file that is missing or no TOML.
  ConfigFile(fs::path path, std::string what, std::string manual);
  ~ConfigFile();
  ConfigFile(const ConfigFile&) = delete;
  ConfigFile& operator=(const ConfigFile&) = delete;

  /// Takes what this file lacks, key by key, from the file that it names as `base`, relative to its folder.
  /// Arrays are taken as a whole. Returns the path of that file, empty where none is named. Throws InputError
  /// where it cannot be read.
  fs::path add_base();
  /// Throws InputError when the file holds another table or key; `known` are shown in that order.
  void check_names(std::initializer_list<const char*> known) const;
  bool has(const std::string& name) const;
  /// Keys outside of all tables. check_names() says which there may be, so finish() is not called for it.
  ConfigSection root() const;
  /// Throws InputError when there is none.
  ConfigSection section(const std::string& name) const;
  /// An empty one when there is none.
  ConfigSection optional_section(const std::string& name) const;
  /// [[name]], at least one.
  std::vector<ConfigSection> sections(const std::string& name) const;
  /// A whole number outside of all tables, at least 0.
  void whole_number(const std::string& key, std::uint64_t& value) const;

 private:
  struct Content;
  fs::path path_;
  std::string what_, manual_;
  std::unique_ptr<Content> content_;
};

}  // namespace refield
