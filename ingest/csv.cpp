// SPDX-License-Identifier: BSD-3-Clause
// Any table that holds a reading in each row, as spreadsheets, loggers and data frames are exported: with a true distance beside
// it as a recording of pairs, without one as readings to be corrected. What the table's header does not say is said by options or
// taken by the rules stated beside each function; the words of the result name every one that was taken.
#include "csv.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <numeric>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "importer.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/csv_rows.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/utf8.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::ingest {
namespace {

constexpr double nothing = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t most_labels = 10'000'000;  ///< that a recording holds

std::string lower(std::string_view text) {
  std::string small(text);
  for (char& c : small)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return small;
}

/// As it can stand in a line: control characters as spaces, at most so many bytes, not ending within a character.
std::string shortened(std::string_view text, std::size_t most = 40) {
  std::string line(text.substr(0, most));
  if (text.size() > most) {
    while (most > 0 && (static_cast<unsigned char>(text[most]) & 0xc0) == 0x80) --most;
    line = std::string(text.substr(0, most)) + "...";
  }
  for (char& c : line)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  return line;
}

std::string in_quotes(std::string_view text) { return "'" + shortened(text) + "'"; }

/// "4, 9, 12-20 and 3 more": rows of the file, ascending.
std::string row_list(const std::vector<int>& rows) {
  constexpr std::size_t most = 8;
  std::string text;
  std::size_t at = 0;
  for (std::size_t shown = 0; at < rows.size() && shown < most; ++shown) {
    std::size_t end = at;
    while (end + 1 < rows.size() && rows[end + 1] == rows[end] + 1) ++end;
    text += (text.empty() ? "" : ", ") + std::to_string(rows[at]);
    if (end > at) text += "-" + std::to_string(rows[end]);
    at = end + 1;
  }
  if (at < rows.size()) text += fmt::format(" and {} more", rows.size() - at);
  return (rows.size() == 1 ? "row " : "rows ") + text;
}

// ---- units -----------------------------------------------------------------------------------------------------------

/// SI = value * times / over: a quotient, so that 57 cm are 0.57 m and not 0.57000000000000006.
struct Unit {
  const char* text;
  double times, over;
};
/// The first of each are those that messages list.
constexpr std::size_t listed_lengths = 8, listed_durations = 6, listed_angles = 3;
constexpr std::array lengths = {
    Unit{"m", 1, 1},          Unit{"mm", 1, 1000},        Unit{"cm", 1, 100},
    Unit{"um", 1, 1e6},       Unit{"km", 1000, 1},        Unit{"in", 254, 10000},
    Unit{"ft", 3048, 10000},  Unit{"yd", 9144, 10000},    Unit{"\xc2\xb5m", 1, 1e6},
    Unit{"inch", 254, 10000}, Unit{"inches", 254, 10000}, Unit{"feet", 3048, 10000},
    Unit{"metre", 1, 1},      Unit{"meter", 1, 1},        Unit{"metres", 1, 1},
    Unit{"meters", 1, 1}};
constexpr std::array durations = {Unit{"s", 1, 1},           Unit{"ms", 1, 1000}, Unit{"us", 1, 1e6},
                                  Unit{"ns", 1, 1e9},        Unit{"min", 60, 1},  Unit{"h", 3600, 1},
                                  Unit{"\xc2\xb5s", 1, 1e6}, Unit{"sec", 1, 1},   Unit{"seconds", 1, 1}};
constexpr std::array angles = {Unit{"rad", 1, 1}, Unit{"deg", std::numbers::pi, 180.0}, Unit{"mrad", 1, 1000},
                               Unit{"degrees", std::numbers::pi, 180.0},
                               Unit{"\xc2\xb0", std::numbers::pi, 180.0}};
/// What a sensor reports that is no length. Such readings stay as they are.
constexpr std::array raw_units = {"V",     "mV", "counts", "count", "adc", "lsb",
                                  "ticks", "s",  "ms",     "us",    "ns",  "raw"};

/// By how much a length is off that was noted in another unit than the others: mm, cm or inches for m, mm for inches, and the
/// other way round. Less, as feet for m, may be an echo.
constexpr std::array factors_of_units = {1000.0, 100.0, 39.37, 25.4, 1.0 / 25.4, 1.0 / 39.37, 0.01, 0.001};

template <typename Units>
const Unit* unit_of(const Units& units, std::string_view text) {
  const std::string small = lower(text);
  for (const Unit& unit : units)
    if (small == unit.text) return &unit;
  return nullptr;
}

const char* raw_unit_of(std::string_view text) {
  for (const char* unit : raw_units)
    if (lower(text) == lower(unit)) return unit;
  return nullptr;
}

template <typename Units>
std::string unit_list(const Units& units, std::size_t count) {
  std::string list;
  for (std::size_t i = 0; i < count; ++i) list += (i ? ", " : "") + std::string(units[i].text);
  return list;
}

/// A column's name cut in two: "range [cm]" is "range" and "cm", "range_cm" and "range cm" too if `known` takes "cm".
template <typename Known>
std::pair<std::string, std::string> stem_and_unit(const std::string& name, const Known& known) {
  if (!name.empty() && (name.back() == ']' || name.back() == ')')) {
    const std::size_t open = name.find_last_of(name.back() == ']' ? '[' : '(');
    if (open != std::string::npos && open > 0 && known(name.substr(open + 1, name.size() - open - 2)))
      return {name.substr(0, open), name.substr(open + 1, name.size() - open - 2)};
  }
  const std::size_t cut = name.find_last_of(" _/");
  if (cut == std::string::npos || cut == 0) return {name, ""};
  const std::string last = name.substr(cut + 1);
  const bool word = lower(last) == "in" && name[cut] == ' ';  // "what comes in" is no inch
  if (word || lower(last) == "raw" || !known(last)) return {name, ""};
  return {name.substr(0, cut), last};
}

bool is_any_unit(std::string_view text) {
  return unit_of(lengths, text) || unit_of(durations, text) || unit_of(angles, text) || raw_unit_of(text);
}

/// A unit with where it comes from.
struct Scale {
  Unit unit{"m", 1, 1};
  std::string words;  ///< "in cm, by its name"
  double si(double value) const { return value * unit.times / unit.over; }
};

template <typename Units>
Scale scale_of(const Units& units, std::size_t listed, const char* option, const std::string& given,
               const std::string& column, std::vector<std::string>& warnings) {
  const auto known = [&](std::string_view text) { return unit_of(units, text) != nullptr; };
  const std::string own = stem_and_unit(column, known).second;
  if (!given.empty()) {
    const Unit* unit = unit_of(units, given);
    if (!unit)
      throw InputError(
          fmt::format("{}: {} is none of {}", option, in_quotes(given), unit_list(units, listed)));
    if (!own.empty() && unit_of(units, own)->times / unit_of(units, own)->over != unit->times / unit->over)
      warnings.push_back(fmt::format("column {} is taken to be in {}, by {}, though its name says {}",
                                     in_quotes(column), unit->text, option, own));
    return {*unit, fmt::format("in {}, by {}", unit->text, option)};
  }
  if (!own.empty()) return {*unit_of(units, own), fmt::format("in {}, by its name", own)};
  return {units[0], ""};
}

// ---- names -----------------------------------------------------------------------------------------------------------

/// Letters and digits alone, small, without the unit: what two spellings of one name share.
std::string folded(const std::string& name) {
  std::string letters;
  for (const char c : lower(stem_and_unit(name, is_any_unit).first))
    if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || static_cast<unsigned char>(c) >= 0x80)
      letters += c;
  return letters;
}

/// Fewest letters to change, add or take away (Levenshtein).
std::size_t edits(std::string_view a, std::string_view b) {
  a = a.substr(0, 64), b = b.substr(0, 64);
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t changed = diagonal + (a[i] != b[j]);
      diagonal = row[j + 1];
      row[j + 1] = std::min({changed, row[j] + 1, diagonal + 1});
    }
  }
  return row[b.size()];
}

std::string list_of(const std::vector<std::string>& names) {
  constexpr std::size_t most = 30;
  std::string list;
  std::size_t shown = 0, named = 0;
  for (const std::string& name : names) {
    if (name.empty()) continue;
    ++named;
    if (shown == most) continue;
    list += (list.empty() ? "" : ", ") + in_quotes(name);
    ++shown;
  }
  if (named > shown) list += fmt::format(" and {} more", named - shown);
  return list;
}

/// The column that is most likely meant by a name that none has.
std::string nearest_name(const std::string& wanted, const std::vector<std::string>& names) {
  const std::string a = folded(wanted);
  std::string nearest;
  std::size_t least = std::max<std::size_t>(2, a.size() / 3) + 1;
  for (const std::string& name : names) {
    const std::string b = folded(name);
    if (a.empty() || b.empty()) continue;
    std::size_t off = edits(a, b);
    if (off >= least && a.size() > 2 && b.find(a) != std::string::npos) off = least - 1;
    if (off < std::min(least, a.size())) least = off, nearest = name;
  }
  return nearest;
}

/// White space of any kind as single spaces: cells of a spreadsheet's header may be broken into lines.
std::string collapsed(std::string_view text) {
  std::string out;
  for (const char c : text) {
    const bool space = c == ' ' || c == '\t' || c == '\n' || c == '\r';
    if (!space)
      out += c;
    else if (!out.empty() && out.back() != ' ')
      out += ' ';
  }
  while (!out.empty() && out.back() == ' ') out.pop_back();
  return out;
}

/// As the header has it, without the "# " that numpy puts before the first; none for an index ("Unnamed: 0" of pandas).
std::vector<std::string> names_in(const CsvRows& rows) {
  std::vector<std::string> names;
  for (const std::string& column : rows.columns()) {
    std::string name = collapsed(column);
    if (names.empty() && name.starts_with("# ")) name.erase(0, 2);
    if (name.starts_with("Unnamed: ")) name.clear();
    if (!name.empty() && std::find(names.begin(), names.end(), name) != names.end())
      throw InputError(rows.file(), rows.line(), name, "the column is named twice");
    names.push_back(std::move(name));
  }
  return names;
}

// ---- fields ----------------------------------------------------------------------------------------------------------

/// How fields stand for numbers and for nothing.
class FieldReader {
 public:
  explicit FieldReader(const TableOptions& given)
      : commas_(given.decimal != "point"), missing_(given.missing.begin(), given.missing.end()) {}

  enum class Kind { nothing, number, text };
  /// `comma`: it was read with a decimal comma.
  Kind read(std::string_view field, double& value, bool& comma) const {
    if (is_missing(field)) return Kind::nothing;
    std::string_view digits = field;
    if (digits.front() == '+' && digits.size() > 1 && digits[1] != '-') digits.remove_prefix(1);
    if (fills(digits, value)) return std::isnan(value) ? Kind::nothing : Kind::number;
    const std::size_t at = digits.find(',');
    std::array<char, 64> copy{};
    if (!commas_ || at == std::string_view::npos || digits.size() > copy.size() ||
        digits.find_first_of(",.", at + 1) != std::string_view::npos ||
        digits.substr(0, at).find('.') != std::string_view::npos)
      return Kind::text;
    std::copy(digits.begin(), digits.end(), copy.begin());
    copy[at] = '.';
    comma = fills({copy.data(), digits.size()}, value) && !std::isnan(value);
    return comma ? Kind::number : Kind::text;
  }

  /// Nothing, what spreadsheets and programs write for it (#N/A, #DIV/0!, NA, null, ...), and the words of --missing.
  bool is_missing(std::string_view field) const {
    if (field.empty()) return true;
    const char first = field.front();
    if (first >= '0' && first <= '9' && missing_.empty()) return false;
    if (missing_.contains(std::string(field))) return true;
    if (first == '#') return true;
    if (field.size() > 4) return false;
    const std::string word = lower(field);
    return word == "na" || word == "n/a" || word == "nan" || word == "null" || word == "none" ||
           word == "-" || word == "--";
  }
  bool is_no_label(std::string_view field) const {
    return field.empty() || missing_.contains(std::string(field));
  }

 private:
  static bool fills(std::string_view digits, double& value) {
    const auto [end, code] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    return code == std::errc() && end == digits.data() + digits.size();
  }

  bool commas_;
  std::set<std::string> missing_;
};

/// A time of day or a date with one, as ISO 8601 writes them: 2024-05-01T12:00:03.25+02:00, 2024-05-01 12:00, 12:00:03.25.
/// Seconds since 1970, in whole ones and their fraction; a time without a zone counts as UTC.
struct Moment {
  long long second = 0;
  double fraction = 0.0;
  bool dated = true;
};

class MomentText {
 public:
  explicit MomentText(std::string_view text) : rest_(text) {}

  std::optional<Moment> read() {
    Moment moment;
    moment.dated = rest_.size() > 4 && (rest_[4] == '-' || rest_[4] == '/');
    if (moment.dated) {
      const char between = rest_[4];
      const auto year = digits(4);
      const bool first = take(between);
      const auto month = digits(2);
      const bool second = take(between);
      const auto day = digits(2);
      if (!year || !month || !day || !first || !second || !(take('T') || take('t') || take(' '))) return {};
      while (take(' ')) continue;
      const std::chrono::year_month_day date{std::chrono::year(*year),
                                             std::chrono::month(static_cast<unsigned>(*month)),
                                             std::chrono::day(static_cast<unsigned>(*day))};
      if (!date.ok()) return {};
      moment.second = 86400LL * std::chrono::sys_days(date).time_since_epoch().count();
    }
    const auto hour = digits(2);
    const bool colon = take(':');
    const auto minute = digits(2);
    if (!hour || !colon || !minute || *hour > 23 || *minute > 59) return {};
    moment.second += 3600LL * *hour + 60LL * *minute;
    if (take(':')) {
      const auto second = digits(2);
      if (!second || *second > 60) return {};
      moment.second += *second;
      if (take('.') || take(',')) {
        if (rest_.empty() || !is_digit(rest_[0])) return {};
        long long part = 0;
        double whole = 1.0;  // the quotient is the nearest number; digits beyond a femtosecond are not used
        for (; !rest_.empty() && is_digit(rest_[0]); rest_.remove_prefix(1))
          if (whole < 1e15) part = 10 * part + (rest_[0] - '0'), whole *= 10.0;
        moment.fraction = static_cast<double>(part) / whole;
      }
    } else if (!moment.dated) {
      return {};
    }
    while (take(' ')) continue;
    if (moment.dated && !take('Z') && !rest_.empty()) {
      const bool west = rest_[0] == '-';
      if (!take('-') && !take('+')) return {};
      const auto hours = digits(2);
      take(':');
      const auto minutes = rest_.empty() ? std::optional(0) : digits(2);
      if (!hours || !minutes) return {};
      moment.second += (west ? 60LL : -60LL) * (60LL * *hours + *minutes);
    }
    return rest_.empty() ? std::optional(moment) : std::nullopt;
  }

 private:
  static bool is_digit(char c) { return c >= '0' && c <= '9'; }
  bool take(char c) {
    if (rest_.empty() || rest_[0] != c) return false;
    rest_.remove_prefix(1);
    return true;
  }
  std::optional<int> digits(std::size_t count) {
    int value = 0;
    for (std::size_t i = 0; i < count; ++i) {
      if (rest_.empty() || !is_digit(rest_[0])) return std::nullopt;
      value = 10 * value + (rest_[0] - '0');
      rest_.remove_prefix(1);
    }
    return value;
  }

  std::string_view rest_;
};

// ---- columns ---------------------------------------------------------------------------------------------------------

/// Labels by their numbers, in the order of appearance.
struct Labels {
  std::vector<std::string> names;
  std::vector<int> of_row;  ///< -1 where a field is empty
  int empty_row = 0;        ///< the first

  void take(const CsvRows& rows, std::size_t column, const FieldReader& reader) {
    const std::string_view field = rows.text(column);
    if (reader.is_no_label(field)) {
      of_row.push_back(-1);
      if (empty_row == 0) empty_row = rows.line();
      return;
    }
    const auto [at, added] =
        numbers_.try_emplace(std::string(rows.label(column)), static_cast<int>(names.size()));
    if (added) names.push_back(at->first);
    if (names.size() > most_labels)
      rows.fail(column, fmt::format("there are more than {} labels", most_labels));
    of_row.push_back(at->second);
  }

 private:
  std::unordered_map<std::string, int> numbers_;
};

/// Times that are no numbers, in seconds after the first one's whole second; times of day go on past midnight.
struct Clock {
  std::optional<Moment> first;
  std::string first_text;
  double last = 0.0;

  std::optional<double> read(std::string_view field) {
    const auto moment = MomentText(field).read();
    if (!moment || (first && first->dated != moment->dated)) return std::nullopt;
    if (!first) first = moment, first_text = field;
    double seconds = static_cast<double>(moment->second - first->second) + moment->fraction;
    if (!moment->dated)
      while (seconds < last - 43200.0) seconds += 86400.0;
    return last = seconds;
  }
};

class TableColumn {
 public:
  explicit TableColumn(std::string name) : name_(std::move(name)) {}

  void take(std::string_view field, int row, const FieldReader& reader) {
    if (text_row_ > 0) {
      if (!reader.is_missing(field)) keep(field);
      return;
    }
    double value = nothing;
    bool comma = false;
    const FieldReader::Kind kind = reader.read(field, value, comma);
    if (kind == FieldReader::Kind::text) {
      text_row_ = row;
      text_ = shortened(field);
      keep(field);
      values_ = {};
      return;
    }
    values_.push_back(kind == FieldReader::Kind::number ? value : nothing);
    if (kind == FieldReader::Kind::nothing) return;
    ++filled_;
    if (comma) {
      if (comma_row_ == 0) comma_row_ = row, comma_ = shortened(field);
      thousands_ = thousands_ && is_thousands(field);
    } else if (point_row_ == 0 && field.find('.') != std::string_view::npos) {
      point_row_ = row;
    }
  }

  const std::string& name() const { return name_; }
  const std::vector<double>& values() const { return values_; }
  bool decimal_commas() const { return comma_row_ > 0; }

  /// Why it cannot be used as numbers, with the row; 0 and nothing where it can.
  std::pair<int, std::string> fault(bool commas_are_decimal) const {
    if (text_row_ > 0) return {text_row_, in_quotes(text_) + " is not a number"};
    if (comma_row_ > 0 && point_row_ > 0)
      return {comma_row_,
              fmt::format("'{}' has a comma, while row {} has a decimal point", comma_, point_row_)};
    if (comma_row_ > 0 && thousands_ && !commas_are_decimal)
      return {comma_row_,
              fmt::format("'{}' may have a decimal comma or one between thousands: say --decimal comma "
                          "or --decimal point, or take out the commas",
                          comma_)};
    return {0, filled_ == 0 ? "holds nothing" : ""};
  }
  /// The texts that it holds where there are few.
  const std::set<std::string>& texts() const { return texts_; }
  bool few_texts() const {
    return !texts_.empty() && texts_.size() <= most_texts && occurrences_ > texts_.size();
  }

 private:
  static constexpr std::size_t most_texts = 8;
  static bool is_thousands(std::string_view field) {
    const std::size_t at = field.find(','), first = field.find_first_not_of("+-");
    return at > first && at - first <= 3 && field[first] != '0' && field.size() == at + 4 &&
           std::all_of(field.begin() + static_cast<std::ptrdiff_t>(at) + 1, field.end(),
                       [](char c) { return c >= '0' && c <= '9'; });
  }
  void keep(std::string_view field) {
    ++occurrences_;
    if (texts_.size() <= most_texts) texts_.insert(shortened(field));
  }

  std::string name_;
  std::vector<double> values_;  ///< NaN where a field is empty; none once a text was met
  std::string text_, comma_;
  int text_row_ = 0, comma_row_ = 0, point_row_ = 0;
  bool thousands_ = true;  ///< each comma may be one between thousands
  std::size_t filled_ = 0, occurrences_ = 0;
  std::set<std::string> texts_;
};

/// Which columns stand for what.
struct Roles {
  std::optional<std::size_t> truth, reading, batch, landmark, bearing, time;
  bool found_truth = false, found_reading = false;  ///< by their names
  /// Taken for their names alone: given up where a field is empty or no label, angle or time.
  std::set<std::size_t> unasked;

  bool has(std::size_t column) const {
    for (const auto* role : {&truth, &reading, &batch, &landmark, &bearing, &time})
      if (*role == column) return true;
    return false;
  }
};

/// The words of a name: letters and digits in small, the unit left out.
std::set<std::string> words_of(const std::string& name) {
  std::set<std::string> words;
  std::string word;
  for (const char c : lower(stem_and_unit(name, is_any_unit).first) + " ") {
    const bool in_word =
        (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || static_cast<unsigned char>(c) >= 0x80;
    if (in_word)
      word += c;
    else if (!word.empty())
      words.insert(std::exchange(word, {}));
  }
  return words;
}

/// The one column whose name holds one of `telling` and else nothing but `allowed` words.
std::optional<std::size_t> unmistakable(const std::vector<std::string>& names,
                                        const std::set<std::string>& telling,
                                        const std::set<std::string>& allowed) {
  std::optional<std::size_t> found;
  for (std::size_t i = 0; i < names.size(); ++i) {
    bool tells = false, other = false;
    for (const std::string& word : words_of(names[i])) {
      tells = tells || telling.contains(word);
      other = other || !(telling.contains(word) || allowed.contains(word));
    }
    if (!tells || other) continue;
    if (found) return std::nullopt;
    found = i;
  }
  return found;
}

class TableImport {
 public:
  enum class Holds { truth_and_reading, reading };
  TableImport(const TableOptions& given, std::string text, Holds holds)
      : given_(given),
        holds_(holds),
        reader_(given),
        text_(std::move(text)),
        separator_(chosen_separator()),
        rows_(CsvRows::parse(text_, given.source, separator_)),
        names_(names_in(rows_)) {}

  Imported pairs() {
    check_header();
    choose_roles();
    read_rows();
    give_up_unasked();
    Recording recording = recording_of();
    words_ = head_words() + words_ + covariate_words(recording) + left_out_words();
    const Counts& counts = recording.counts;
    words_ += fmt::format("Rows       {} read, {} used", counts.read, counts.used);
    words_ += dropped_.empty() ? "; none left out\n" : "; left out:\n";
    for (const auto& [reason, rows] : dropped_)
      words_ += fmt::format("           {} {} ({})\n", rows.size(), reason, row_list(rows));
    if (!blank_.empty())
      words_ += fmt::format("           {} with nothing in them ({})\n", blank_.size(), row_list(blank_));
    return {std::move(recording), std::move(words_), "", {given_.source}, std::move(warnings_)};
  }

  ReadingsTable readings() {
    check_header();
    choose_roles();
    read_rows();
    give_up_unasked();
    ReadingsTable table;
    table.separator = separator_;
    table.decimal_commas = decimal_commas();
    table.columns = names_;
    const std::vector<double>& readings = numbers(*roles_.reading);
    std::string raw;
    const Scale scale = reading_scale(raw);
    const std::vector<double> bearing = bearings(), time = times();
    table.words = fmt::format("the reading is column {}{}, {}", in_quotes(names_[*roles_.reading]),
                              found_words(roles_.found_reading),
                              scale.words.empty() ? "taken to be in m (--unit)" : scale.words);
    for (const auto& [role, what] : {std::pair{roles_.landmark, "landmark"},
                                     {roles_.batch, "batch"},
                                     {roles_.time, "time"},
                                     {roles_.bearing, "bearing"}})
      if (role) table.words += fmt::format("; {} is column {}", what, in_quotes(names_[*role]));
    CsvRows rows = CsvRows::parse(text_, given_.source, separator_);  // once more, for the fields as they are
    using Field = std::function<std::string(std::size_t row)>;
    const auto label_of = [](const Labels& labels) -> Field {
      return [&labels](std::size_t i) {
        const int number = labels.of_row[i];
        return number < 0 ? "" : csv_field(labels.names[static_cast<std::size_t>(number)]);
      };
    };
    const auto value_of = [](const std::vector<double>& values) -> Field {
      return [&values](std::size_t i) { return number_field(values[i]); };
    };
    std::vector<std::pair<std::string, Field>> columns{
        {"reading_m",
         [&](std::size_t i) { return number_field(readings.empty() ? nothing : scale.si(readings[i])); }}};
    if (!time.empty()) columns.emplace_back("time_s", value_of(time));
    if (!bearing.empty()) columns.emplace_back("bearing_rad", value_of(bearing));
    if (roles_.landmark) columns.emplace_back("landmark", label_of(landmarks_));
    if (roles_.batch) columns.emplace_back("batch", label_of(batches_));
    for (const auto& [name, column] : other_columns())
      columns.emplace_back(csv_field(name),
                           [&rows, this, c = column](std::size_t) { return as_field(rows.text(c), c); });

    int line = 1;
    const auto add = [&](int in_line, const std::string& row, const std::string& as_it_was) {
      table.csv.append(static_cast<std::size_t>(std::max(0, in_line - line)), '\n') += row + "\n";
      line = std::max(line, in_line) + 1 + static_cast<int>(std::count(row.begin(), row.end(), '\n'));
      table.lines.push_back(as_it_was);
    };
    std::string row;
    for (const auto& [name, field] : columns) row += (row.empty() ? "" : ",") + name;
    add(rows.line(), row, joined(rows.columns()));
    std::vector<std::string> own(names_.size());
    for (std::size_t i = 0; i < lines_.size(); ++i) {
      while (rows.next() && rows.line() != lines_[i]) continue;
      row.clear();
      for (const auto& [name, field] : columns) row += (row.empty() ? "" : ",") + field(i);
      for (std::size_t c = 0; c < own.size(); ++c) own[c] = rows.text(c);
      add(lines_[i], row, joined(own));
    }
    table.warnings = std::move(warnings_);
    return table;
  }

 private:
  [[noreturn]] void refuse(const std::string& what) const { throw InputError(given_.source, 0, "", what); }

  // -- the text

  /// Blanks out the first lines, so that the others keep their numbers: --skip of them, then "sep=;" as Excel writes and reads.
  char chosen_separator() {
    if (text_.starts_with("PK\x03\x04")) refuse("is a workbook, not text: save the sheet as CSV");
    if (const std::size_t bad = first_bad_byte(text_); bad != std::string::npos) {
      const auto row = 1 + std::count(text_.begin(), text_.begin() + static_cast<std::ptrdiff_t>(bad), '\n');
      const bool utf16 = text_.starts_with("\xff\xfe") || text_.starts_with("\xfe\xff");
      throw InputError(given_.source, row, "",
                       utf16                ? "is UTF-16 text: save it as CSV in UTF-8"
                       : text_[bad] == '\0' ? "holds a NUL byte: this is no text"
                                            : "is not UTF-8 text: save it as 'CSV UTF-8'");
    }
    std::size_t begin = text_.starts_with(byte_order_mark) ? byte_order_mark.size() : 0;
    const auto line_end = [&](std::size_t from) {
      return std::min(text_.find_first_of("\r\n", from), text_.size());
    };
    const auto blank_out = [&](std::size_t end) {
      std::fill(text_.begin() + static_cast<std::ptrdiff_t>(begin),
                text_.begin() + static_cast<std::ptrdiff_t>(end), ' ');
      begin = std::min(end + (text_.compare(end, 2, "\r\n") == 0 ? 2 : 1), text_.size());
    };
    for (int i = 0; i < given_.skip && begin < text_.size(); ++i) blank_out(line_end(begin));
    char said = 0;
    if (const std::size_t end = line_end(begin); end == begin + 5 && text_.compare(begin, 4, "sep=") == 0) {
      said = text_[begin + 4];
      blank_out(end);
    }
    if (!given_.separator.empty()) return given_.separator[0];
    if (said == ',' || said == ';' || said == '\t' || said == '|') return said;
    return likely_separator(std::string_view(text_).substr(begin));
  }

  /// The one that cuts most of the first 20 rows into as many fields as the header; of equals the first of tab, semicolon, bar,
  /// comma: a comma may also be a decimal one.
  static char likely_separator(std::string_view text) {
    constexpr std::string_view candidates = "\t;|,";
    std::vector<std::array<int, candidates.size()>> counts(1);
    bool quoted = false, blank = true;
    for (const char c : text) {
      if (c == '"') quoted = !quoted;
      if (!quoted && (c == '\n' || c == '\r')) {
        if (!blank) counts.emplace_back();
        if (counts.size() > 21) break;
        blank = true;
        continue;
      }
      blank = blank && (c == ' ' || c == '\t');
      const std::size_t which = candidates.find(c);
      if (!quoted && which != std::string_view::npos) ++counts.back()[which];
    }
    if (blank && counts.size() > 1) counts.pop_back();
    char best = ',';
    int most = -1;
    for (std::size_t which = 0; which < candidates.size(); ++which) {
      if (counts[0][which] == 0) continue;
      const auto alike = static_cast<int>(std::count_if(
          counts.begin() + 1, counts.end(), [&](const auto& row) { return row[which] == counts[0][which]; }));
      if (alike > most) most = alike, best = candidates[which];
    }
    return best;
  }

  void check_header() const {
    if (names_.size() < 2 && holds_ == Holds::truth_and_reading)
      throw InputError(given_.source, rows_.line(), "",
                       "the header is one field, " + in_quotes(names_[0]) +
                           ": columns are separated by commas, semicolons, tabs or bars (--separator)");
    const bool numbers = std::all_of(names_.begin(), names_.end(), [&](const std::string& name) {
      double value = 0.0;
      bool comma = false;
      return !name.empty() && reader_.read(name, value, comma) == FieldReader::Kind::number;
    });
    if (numbers)
      throw InputError(given_.source, rows_.line(), "",
                       "holds numbers where the columns' names are expected: put a header row above it");
  }

  // -- which column is which

  std::optional<std::size_t> named(const char* option, const std::string& name) const {
    if (name.empty()) return std::nullopt;
    const auto found = std::find(names_.begin(), names_.end(), collapsed(name));
    if (found != names_.end()) return static_cast<std::size_t>(found - names_.begin());
    const std::string near = nearest_name(name, names_);
    throw InputError(
        given_.source, rows_.line(), "",
        fmt::format("{}: there is no column {}{}; the columns are {}", option, in_quotes(name),
                    near.empty() ? "" : ", did you mean " + in_quotes(near) + "?", list_of(names_)));
  }

  void choose_roles() {
    roles_ = {named("--true", given_.truth),
              named("--reading", given_.reading),
              named("--batch", given_.batch),
              named("--landmark", given_.landmark),
              named("--bearing", given_.bearing),
              named("--time", given_.time),
              false,
              false,
              {}};
    std::map<std::size_t, const char*> taken;
    for (const auto& [option, column] : {std::pair{"--true", roles_.truth},
                                         {"--reading", roles_.reading},
                                         {"--batch", roles_.batch},
                                         {"--landmark", roles_.landmark},
                                         {"--bearing", roles_.bearing},
                                         {"--time", roles_.time}})
      if (column && !taken.emplace(*column, option).second)
        throw InputError(given_.source, rows_.line(), names_[*column],
                         fmt::format("is given as {} and as {}", taken.at(*column), option));
    const std::set<std::string> distance{"distance", "dist", "range", "value", "d"};
    const auto find = [&](std::optional<std::size_t>& role, const std::set<std::string>& telling,
                          const std::set<std::string>& allowed) {
      if (role) return false;
      const auto found = unmistakable(names_, telling, allowed);
      if (!found || roles_.has(*found)) return false;
      role = found;
      return true;
    };
    const bool truth_wanted = holds_ == Holds::truth_and_reading;
    if (truth_wanted)
      roles_.found_truth = find(
          roles_.truth, {"true", "truth", "groundtruth", "gt", "reference", "ref", "actual", "known"}, [&] {
            auto all = distance;
            all.insert("ground");
            return all;
          }());
    else
      for (const char* const name : {"reading_m", "range_m"})
        if (const auto found = std::find(names_.begin(), names_.end(), name);
            !roles_.reading && found != names_.end())
          roles_.reading = static_cast<std::size_t>(found - names_.begin());
    roles_.found_reading =
        find(roles_.reading, {"reading", "readings", "measured", "measurement", "raw", "sensor"}, distance);
    if ((truth_wanted && !roles_.truth) || !roles_.reading) {
      const std::string missing =
          roles_.truth || !truth_wanted ? "which column is the reading? say --reading COLUMN"
          : roles_.reading              ? "which column is the true distance? say --true COLUMN"
                                        : "which columns are the true distance and the reading? say --true "
                                          "COLUMN --reading COLUMN";
      throw InputError(given_.source, rows_.line(), "", missing + "; the columns are " + list_of(names_));
    }
    const auto by_name = [&](std::optional<std::size_t>& role, const std::set<std::string>& telling,
                             const std::set<std::string>& allowed = {}) {
      if (find(role, telling, allowed)) roles_.unasked.insert(*role);
    };
    by_name(roles_.batch, {"batch"});
    by_name(roles_.landmark, {"landmark"});
    by_name(roles_.bearing, {"bearing"});
    by_name(roles_.time, {"time", "timestamp", "datetime"}, {"date", "stamp"});
  }

  // -- the rows

  void read_rows() {
    for (const std::string& name : names_) columns_.emplace_back(name);
    while (rows_.next()) {
      bool any = false;
      for (std::size_t c = 0; c < columns_.size() && !any; ++c) any = !rows_.text(c).empty();
      if (!any) {
        blank_.push_back(rows_.line());
        continue;
      }
      lines_.push_back(rows_.line());
      for (std::size_t c = 0; c < columns_.size(); ++c)
        if (!names_[c].empty()) columns_[c].take(rows_.text(c), rows_.line(), reader_);
      if (roles_.batch) batches_.take(rows_, *roles_.batch, reader_);
      if (roles_.landmark) landmarks_.take(rows_, *roles_.landmark, reader_);
      if (roles_.time) take_time(rows_.text(*roles_.time));
    }
    if (lines_.empty())
      refuse(blank_.empty() ? "holds a header and no rows" : "holds a header and empty rows");
  }

  /// Texts of the time column; its numbers are read as those of any column.
  void take_time(std::string_view field) {
    const bool missing = reader_.is_missing(field);
    const auto seconds = missing ? std::optional(nothing) : clock_.read(field);
    double number = 0.0;
    bool comma = false;
    const bool neither =
        !seconds && (clock_.first || reader_.read(field, number, comma) == FieldReader::Kind::text);
    if (!seconds && (clock_row_ == 0 || (clock_text_.empty() && neither))) {
      clock_row_ = rows_.line();
      clock_text_ = neither ? shortened(field) : "";
    }
    clock_s_.push_back(seconds.value_or(nothing));
  }

  bool commas_are_decimal() const { return separator_ == ';' || given_.decimal == "comma"; }

  /// Throws, naming row and column, for what cannot be used as numbers.
  const std::vector<double>& numbers(std::size_t column) const {
    const auto [row, fault] = columns_[column].fault(commas_are_decimal());
    if (row == 0) return columns_[column].values();
    const bool text = fault.ends_with("is not a number");
    throw InputError(given_.source, row, names_[column],
                     fault + (text ? ": mend it, or say --missing TEXT where it stands for no value" : ""));
  }

  /// All fields of a column of times are texts of moments, empty ones aside.
  bool is_clock() const { return clock_row_ == 0 && clock_.first; }

  /// Of readings alone a gap does not matter: what needs the field is said of its row.
  void give_up_unasked() {
    const bool whole = holds_ == Holds::truth_and_reading;
    const auto give_up = [&](std::optional<std::size_t>& role, const char* option, const std::string& why) {
      if (!role || !roles_.unasked.contains(*role) || why.empty()) return;
      warnings_.push_back(
          fmt::format("column {} is not taken as {}: {}", in_quotes(names_[*role]), option, why));
      role.reset();
    };
    const auto bad_numbers = [&](const std::optional<std::size_t>& role) -> std::string {
      if (!role) return "";
      const auto [row, fault] = columns_[*role].fault(commas_are_decimal());
      if (row > 0) return fmt::format("row {}: {}", row, fault);
      for (std::size_t i = 0; whole && i < lines_.size(); ++i)
        if (!std::isfinite(columns_[*role].values()[i]))
          return fmt::format("row {} holds no number", lines_[i]);
      return "";
    };
    give_up(roles_.landmark, "--landmark",
            whole && landmarks_.empty_row > 0 ? fmt::format("row {} is empty", landmarks_.empty_row) : "");
    give_up(roles_.bearing, "--bearing", bad_numbers(roles_.bearing));
    std::string why = is_clock() ? "" : bad_numbers(roles_.time);
    if (is_clock() && whole)
      for (std::size_t i = 0; i < lines_.size() && why.empty(); ++i)
        if (std::isnan(clock_s_[i])) why = fmt::format("row {} is empty", lines_[i]);
    give_up(roles_.time, "--time", why);
  }

  // -- the recording

  std::string range_words(const std::vector<double>& values) const {
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    return fmt::format("{:.6g} to {:.6g}", *low, *high);
  }

  std::string found_words(bool found) const { return found ? ", taken for its name" : ""; }

  Scale truth_scale() {
    return scale_of(lengths, listed_lengths, given_.true_unit.empty() ? "--unit" : "--true-unit",
                    given_.true_unit.empty() ? given_.unit : given_.true_unit, names_[*roles_.truth],
                    warnings_);
  }

  /// Of readings that are no length `raw` is set.
  Scale reading_scale(std::string& raw) {
    const std::string& name = names_[*roles_.reading];
    const std::string& given = given_.reading_unit.empty() ? given_.unit : given_.reading_unit;
    const auto known = [](std::string_view text) { return unit_of(lengths, text) || raw_unit_of(text); };
    const std::string own = stem_and_unit(name, known).second, unit = given.empty() ? own : given;
    if (const char* other = unit_of(lengths, unit) ? nullptr : raw_unit_of(unit)) {
      raw = other;
      return {Unit{other, 1, 1},
              fmt::format("in {}, {}", other, given.empty() ? "by its name" : "by --reading-unit")};
    }
    if (!given.empty() && !unit_of(lengths, given)) {
      std::string others;
      for (const char* text : raw_units) others += std::string(", ") + text;
      throw InputError(fmt::format("--reading-unit: {} is none of {}{}", in_quotes(given),
                                   unit_list(lengths, listed_lengths), others));
    }
    return scale_of(lengths, listed_lengths, given_.reading_unit.empty() ? "--unit" : "--reading-unit", given,
                    name, warnings_);
  }

  /// Radians; without a unit in option or name degrees where an angle is beyond a full turn, else radians.
  std::vector<double> bearings() {
    if (!roles_.bearing) return {};
    std::vector<double> values = numbers(*roles_.bearing);
    Scale scale = scale_of(angles, listed_angles, "--bearing-unit", given_.bearing_unit,
                           names_[*roles_.bearing], warnings_);
    if (scale.words.empty()) {
      const bool degrees = std::any_of(values.begin(), values.end(), [](double v) {
        return std::isfinite(v) && std::abs(v) > 2.0 * std::numbers::pi;
      });
      if (degrees) scale.unit = angles[1];
      scale.words =
          degrees ? "in deg, since some are beyond a turn in radians" : "taken to be in rad (--bearing-unit)";
    }
    for (std::size_t i = 0; i < values.size(); ++i) {
      values[i] = scale.si(values[i]);
      if (std::string_view(scale.unit.text) == "rad" && std::abs(values[i]) > 2.0 * std::numbers::pi)
        throw InputError(
            given_.source, lines_[i], names_[*roles_.bearing],
            fmt::format("{:g} rad is beyond a turn: are these degrees? (--bearing-unit deg)", values[i]));
      values[i] = wrap_angle(values[i]);
    }
    words_ += fmt::format("Bearing    column {}, {}\n", in_quotes(names_[*roles_.bearing]), scale.words);
    return values;
  }

  /// Seconds after the earliest. Numbers without a unit in option or name are taken for seconds, or where they are as large as
  /// times since 1970 (after 2001) in ms, us or ns, for those.
  std::vector<double> times() {
    if (!roles_.time) return {};
    const std::string& name = names_[*roles_.time];
    std::vector<double> values;
    std::string words, from;
    if (is_clock()) {
      values = clock_s_;
      words = clock_.first->dated ? "date and time" : "time of day";
      from = clock_.first_text;
    } else {
      const auto [row, fault] = columns_[*roles_.time].fault(commas_are_decimal());
      if (row > 0) {
        if (clock_text_.empty() || !fault.ends_with("is not a number"))
          throw InputError(given_.source, row, name, fault);
        throw InputError(given_.source, clock_row_, name,
                         in_quotes(clock_text_) +
                             " is no time as ISO 8601 has it (2024-05-01T12:00:00.5), and not all fields "
                             "of the column are numbers");
      }
      values = columns_[*roles_.time].values();
      Scale scale = scale_of(durations, listed_durations, "--time-unit", given_.time_unit, name, warnings_);
      double largest = 0.0;
      for (const double value : values)
        if (std::isfinite(value)) largest = std::max(largest, std::abs(value));
      if (scale.words.empty()) {
        constexpr double since_2001 = 1e9;  // s
        for (const auto& [unit, per_second] : {std::pair{2, 1e6}, {1, 1e3}, {3, 1e9}})
          if (largest > since_2001 * per_second && largest < 10.0 * since_2001 * per_second)
            scale.unit = durations[static_cast<std::size_t>(unit)];
        scale.words = scale.unit.over > 1.0 ? fmt::format("{} since 1970, by their size", scale.unit.text)
                                            : "taken to be in s (--time-unit)";
      }
      const double base = first_finite(values);
      for (double& value : values)
        value = scale.si(value - base);  // first the difference: digits are not lost
      words = scale.words;
      from = fmt::format("{}", base);
    }
    double earliest = std::numeric_limits<double>::infinity();
    for (const double value : values)
      if (std::isfinite(value)) earliest = std::min(earliest, value);
    for (double& value : values) value -= earliest;
    words_ += fmt::format("Time       column {}, {}; s after the earliest{}\n", in_quotes(name), words,
                          earliest == 0.0 ? " (" + from + ")" : "");
    return values;
  }

  static double first_finite(const std::vector<double>& values) {
    const auto found = std::find_if(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
    return found == values.end() ? 0.0 : *found;
  }

  /// Why a row cannot be used, in the order asked; nullptr where it can. `counted`: the reason in a recording's counts.
  const char* unusable(std::size_t i, double truth, double reading, const std::vector<double>& bearing,
                       const std::vector<double>& time, const char*& counted) const {
    counted = "missing";
    if (std::isnan(truth)) return "without a true distance";
    if (std::isnan(reading)) return "without a reading";
    if (roles_.landmark && landmarks_.of_row[i] < 0) return "without a landmark";
    if (!bearing.empty() && std::isnan(bearing[i])) return "without a bearing";
    if (!time.empty() && std::isnan(time[i])) return "without a time";
    counted = "not finite";
    if (std::isinf(truth)) return "whose true distance is infinite";
    if (std::isinf(reading)) return "whose reading is infinite";
    if (!time.empty() && std::isinf(time[i])) return "whose time is infinite";
    counted = "true distance not positive";
    if (!(truth > 0.0)) return "whose true distance is not above 0";
    counted = "zero";
    if (reading == 0.0) return "whose reading is 0";
    counted = "negative";
    return reading < 0.0 ? "whose reading is negative" : nullptr;
  }

  Recording recording_of() {
    Recording recording;
    recording.kind = RecordingKind::pairs;
    recording.sensor.name =
        given_.name.empty() ? std::filesystem::path(given_.source).stem().string() : given_.name;
    const std::vector<double>&truths = numbers(*roles_.truth), &readings = numbers(*roles_.reading);
    const Scale truth = truth_scale(), reading = reading_scale(recording.sensor.unit);
    const std::vector<double> bearing = bearings(), time = times();
    const std::vector<std::pair<std::string, std::size_t>> covariates = covariate_columns();
    Pairs& pairs = recording.pairs;
    std::vector<int> landmark_numbers(landmarks_.names.size(), -1), batch_numbers(batches_.names.size(), -1);
    const auto numbered = [](int label, std::vector<int>& numbers, const auto& add) {
      if (label < 0) return -1;
      int& number = numbers[static_cast<std::size_t>(label)];
      if (number < 0) number = add(static_cast<std::size_t>(label));
      return number;
    };
    std::vector<std::size_t> used;
    for (std::size_t i = 0; i < lines_.size(); ++i) {
      const double d = truth.si(truths.empty() ? nothing : truths[i]),
                   y = reading.si(readings.empty() ? nothing : readings[i]);
      const char* counted = nullptr;
      if (const char* why = unusable(i, d, y, bearing, time, counted)) {
        drop(why, lines_[i]);
        ++recording.counts.dropped[counted];
        continue;
      }
      used.push_back(i);
      pairs.true_m.push_back(d), pairs.reading_m.push_back(y);
      pairs.row.push_back(static_cast<int>(pairs.size()) + 1);
      if (!bearing.empty()) pairs.bearing_rad.push_back(bearing[i]);
      if (!time.empty()) pairs.time_s.push_back(time[i]);
      if (roles_.landmark)
        pairs.landmark.push_back(numbered(landmarks_.of_row[i], landmark_numbers, [&](std::size_t label) {
          recording.landmarks.push_back({landmarks_.names[label], 0.0, std::nullopt});
          return static_cast<int>(recording.landmarks.size()) - 1;
        }));
      if (roles_.batch)
        pairs.batch.push_back(numbered(batches_.of_row[i], batch_numbers, [&](std::size_t label) {
          pairs.batch_labels.push_back(batches_.names[label]);
          return static_cast<int>(pairs.batch_labels.size()) - 1;
        }));
    }
    recording.counts.read = static_cast<int>(lines_.size());
    recording.counts.used = static_cast<int>(pairs.size());
    if (used.empty()) {
      std::string reasons;
      for (const auto& [reason, rows] : dropped_)
        reasons +=
            fmt::format("{}{} {} ({})", reasons.empty() ? "" : ", ", rows.size(), reason, row_list(rows));
      refuse("no row can be used: " + reasons);
    }
    for (const auto& [name, column] : covariates) {
      std::vector<double>& values = pairs.covariates[name];
      values.reserve(used.size());
      for (const std::size_t i : used) values.push_back(columns_[column].values()[i]);
    }
    say_columns(recording, truth, reading);
    if (recording.sensor.unit.empty()) warn_of_strange_rows(pairs, used, reading);
    return recording;
  }

  void drop(const char* why, int row) {
    const auto found =
        std::find_if(dropped_.begin(), dropped_.end(), [&](const auto& one) { return one.first == why; });
    if (found != dropped_.end())
      found->second.push_back(row);
    else
      dropped_.push_back({why, {row}});
  }

  /// A column's name as a covariate: one that a recording gives another meaning is changed.
  std::string covariate_name(std::size_t column) {
    const std::set<std::string> known{"true_m", "reading_m", "batch", "time_s", "landmark", "bearing_rad"};
    std::string name = names_[column];
    if (!known.contains(name)) return name;
    name = "column_" + name;
    while (std::find(names_.begin(), names_.end(), name) != names_.end()) name += "_";
    renamed_.push_back(in_quotes(names_[column]) + " as " + in_quotes(name));
    return name;
  }

  /// Every other column of numbers; what cannot be one is kept to be said.
  std::vector<std::pair<std::string, std::size_t>> covariate_columns() {
    std::vector<std::pair<std::string, std::size_t>> covariates;
    for (std::size_t c = 0; c < columns_.size(); ++c) {
      if (roles_.has(c)) continue;
      if (names_[c].empty()) {
        left_out_.push_back(fmt::format("column {} has no name", c + 1));
        continue;
      }
      const auto [row, fault] = columns_[c].fault(commas_are_decimal());
      if (row > 0 || !fault.empty()) {
        left_out_.push_back(in_quotes(names_[c]) + (row > 0 ? fmt::format(": row {}: ", row) : " ") + fault +
                            hint_for(c));
        continue;
      }
      covariates.emplace_back(covariate_name(c), c);
    }
    return covariates;
  }

  /// Every column that stands for nothing else, of numbers or not.
  std::vector<std::pair<std::string, std::size_t>> other_columns() {
    std::vector<std::pair<std::string, std::size_t>> others;
    for (std::size_t c = 0; c < columns_.size(); ++c)
      if (!roles_.has(c) && !names_[c].empty()) others.emplace_back(covariate_name(c), c);
    return others;
  }

  // -- readings alone

  std::string joined(const std::vector<std::string>& fields) const {
    std::string line;
    for (std::size_t c = 0; c < fields.size(); ++c) {
      if (c > 0) line += separator_;
      line += csv_field(fields[c], separator_);
    }
    return line;
  }

  static std::string number_field(double value) {
    return std::isnan(value) ? "NA" : fmt::format("{}", value);
  }

  /// A field as 'correct' reads it: nothing for a missing value, no decimal comma; else as it is.
  std::string as_field(std::string_view field, std::size_t column) const {
    double value = 0.0;
    bool comma = false;
    if (reader_.is_missing(field)) return "";
    const bool number = columns_[column].fault(commas_are_decimal()).first == 0 &&
                        reader_.read(field, value, comma) == FieldReader::Kind::number;
    return number && (comma || field.front() == '+') ? number_field(value) : csv_field(std::string(field));
  }

  std::string hint_for(std::size_t column) const {
    const TableColumn& own = columns_[column];
    if (own.texts().empty()) return "";
    if (MomentText(*own.texts().begin()).read()) return "; --time takes it as times";
    if (!own.few_texts()) return "";
    std::string texts;
    for (const std::string& text : own.texts()) texts += (texts.empty() ? "" : ", ") + text;
    return fmt::format("; --landmark or --batch takes its texts ({}) as labels", texts);
  }

  // -- the words

  void say_columns(const Recording& recording, const Scale& truth, const Scale& reading) {
    const Pairs& pairs = recording.pairs;
    const bool raw = !recording.sensor.unit.empty();
    const char* assumed = "taken to be in m (--unit)";
    std::string head = fmt::format("Truth      column {}{}, {}: {} m\n", in_quotes(names_[*roles_.truth]),
                                   found_words(roles_.found_truth),
                                   truth.words.empty() ? assumed : truth.words, range_words(pairs.true_m));
    head += fmt::format("Reading    column {}{}, {}: {} {}{}\n", in_quotes(names_[*roles_.reading]),
                        found_words(roles_.found_reading), reading.words.empty() ? assumed : reading.words,
                        range_words(pairs.reading_m), raw ? recording.sensor.unit : "m",
                        raw ? "; no length: left as they are" : "");
    if (roles_.batch)
      head += fmt::format("Batch      column {}, {} labels\n", in_quotes(names_[*roles_.batch]),
                          pairs.batch_labels.size());
    if (roles_.landmark) {
      std::vector<std::string> labels;
      for (std::size_t i = 0; i < std::min<std::size_t>(recording.landmarks.size(), 9); ++i)
        labels.push_back(i < 8 ? shortened(recording.landmarks[i].label) : "...");
      head += fmt::format("Landmark   column {}, {} labels: {}\n", in_quotes(names_[*roles_.landmark]),
                          recording.landmarks.size(), fmt::join(labels, ", "));
    }
    words_ = head + words_;
    const double d = upper_median(pairs.true_m), y = upper_median(pairs.reading_m);
    if (!raw && (y > 8.0 * d || d > 8.0 * y))
      warnings_.push_back(fmt::format(
          "the middle reading is {:.4g} m and the middle true distance {:.4g} m: is one of them in another "
          "unit? (--true-unit, --reading-unit)",
          y, d));
    else if (d > 150.0 && truth.words.empty())
      warnings_.push_back(
          fmt::format("the middle true distance is {:.4g} m: if the table is in mm or cm, say --unit", d));
  }

  /// Says which readings are the others' in another unit, and which values stand for no reading: no noise makes either. `used`: the
  /// index of each pair's row.
  void warn_of_strange_rows(const Pairs& pairs, const std::vector<std::size_t>& used, const Scale& unit) {
    constexpr double far_off = 8.0, alike = 0.15;
    std::vector<double> ratios(pairs.size());
    for (std::size_t i = 0; i < ratios.size(); ++i) ratios[i] = pairs.reading_m[i] / pairs.true_m[i];
    const double usual = upper_median(ratios),
                 farthest = *std::max_element(pairs.true_m.begin(), pairs.true_m.end());
    std::map<double, std::vector<int>> by_factor, by_value;
    for (std::size_t i = 0; i < ratios.size(); ++i) {
      const double factor = ratios[i] / usual;
      if (factor < far_off && factor > 1.0 / far_off) continue;
      const double* other = std::find_if(factors_of_units.begin(), factors_of_units.end(), [&](double known) {
        return std::abs(factor / known - 1.0) < alike;
      });
      if (other != factors_of_units.end()) by_factor[*other].push_back(lines_[used[i]]);
      if (pairs.reading_m[i] > far_off * usual * farthest)
        by_value[pairs.reading_m[i]].push_back(lines_[used[i]]);
    }
    for (const auto& [value, rows] : by_value) {
      constexpr double beyond_any_echo = 1e4;  // times the farthest
      if (rows.size() < 2 && value < beyond_any_echo * usual * farthest) continue;
      warnings_.push_back(fmt::format(
          "{} {} {:g}, far beyond the farthest distance of {:.4g} m: if that stands for no reading, give its text to --missing",
          row_list(rows), rows.size() == 1 ? "reads" : "read", value * unit.unit.over / unit.unit.times,
          farthest));
      for (auto& [factor, others] : by_factor)
        std::erase_if(others, [&](int row) { return std::binary_search(rows.begin(), rows.end(), row); });
    }
    for (const auto& [factor, rows] : by_factor)
      if (!rows.empty())
        warnings_.push_back(fmt::format(
            "{}: the reading is {} what others are at such a distance: is it in "
            "another unit?",
            row_list(rows),
            factor > 1.0 ? fmt::format("{:g} times", factor) : fmt::format("a {:g}th of", 1.0 / factor)));
  }

  std::string head_words() const {
    const char* separator = separator_ == ','    ? "commas"
                            : separator_ == ';'  ? "semicolons"
                            : separator_ == '\t' ? "tabs"
                                                 : "bars";
    return fmt::format("Table      {}: {} rows, {} columns separated by {}{}\n", given_.source,
                       lines_.size() + blank_.size(), names_.size(), separator,
                       decimal_commas() ? ", decimal commas" : "");
  }
  bool decimal_commas() const {
    return std::any_of(columns_.begin(), columns_.end(), [](const auto& column) {
      return column.decimal_commas() && !column.values().empty();
    });
  }

  std::string covariate_words(const Recording& recording) const {
    std::vector<std::string> names;
    for (const auto& [name, values] : recording.pairs.covariates) names.push_back(name);
    std::string words = "Covariates " + (names.empty() ? "none" : list_of(names)) + "\n";
    for (const std::string& one : renamed_)
      words += "           " + one + ", since the name has a meaning of its own in a recording\n";
    return words;
  }

  std::string left_out_words() const {
    std::string words;
    for (const std::string& one : left_out_)
      words += (words.empty() ? "Left out   " : "           ") + one + "\n";
    return words;
  }

  const TableOptions& given_;
  Holds holds_;
  FieldReader reader_;
  std::string text_;
  char separator_;
  CsvRows rows_;
  std::vector<std::string> names_;
  Roles roles_;
  std::vector<TableColumn> columns_;
  Labels batches_, landmarks_;
  Clock clock_;
  std::vector<double> clock_s_;
  std::string clock_text_;
  int clock_row_ = 0;  ///< the first time that is no moment
  std::vector<int> lines_, blank_;
  std::vector<std::pair<std::string, std::vector<int>>> dropped_;
  std::vector<std::string> left_out_, renamed_, warnings_;
  std::string words_;
};

void check_table_options(TableOptions& given) {
  const std::map<std::string, std::string> separators{
      {"comma", ","}, {"semicolon", ";"}, {"tab", "\t"}, {"bar", "|"}};
  if (const auto word = separators.find(given.separator); word != separators.end())
    given.separator = word->second;
  if (!given.separator.empty() && std::string_view(",;\t|").find(given.separator) == std::string_view::npos)
    throw InputError("--separator: '" + shortened(given.separator) +
                     "' is none of comma, semicolon, tab, bar");
  if (!given.decimal.empty() && given.decimal != "comma" && given.decimal != "point")
    throw InputError("--decimal: '" + shortened(given.decimal) + "' is neither comma nor point");
  if (given.skip < 0) throw InputError("--skip must not be negative");
}

std::function<Imported()> add_csv(CLI::App& command) {
  const auto given = std::make_shared<TableOptions>();
  command
      .add_option("FILE", given->source,
                  "the table: CSV as a spreadsheet, a logger or a data frame writes it")
      ->required();
  command.add_option("--true", given->truth, "name of the column with the true distances");
  command.add_option("--true-unit", given->true_unit, "of the true distances alone");
  add_table_options(command, *given);
  command.add_option("--name", given->name, "of the sensor; else the file's");
  command.footer(
      "A row of the table is one reading of a target at a known distance. Every other column of numbers is kept as a\n"
      "covariate: 'diagnose' looks for what the error depends on by its name. Columns of texts cannot be; those of few\n"
      "texts, such as surfaces or the serial numbers of sensors, can be labels (--landmark). Which columns were taken, which not and why, and each row left out are said.\n"
      "\n"
      "Recognised: commas, semicolons, tabs; decimal commas; units in names, 'range [cm]', 'range_mm'; columns called\n"
      "truth, reference, reading, measured, time, bearing, landmark, batch; times since 1970 in s, ms, us, ns. Empty fields,\n"
      "NA, null, #N/A and other errors of spreadsheets are missing values.\n"
      "\n"
      "Examples:\n"
      "  rangecal import csv readings.csv --true 'distance [cm]' --reading sonar --unit cm -o rec\n"
      "  rangecal import csv log.csv --true 'tape (m)' --reading raw_mm --time timestamp --landmark surface -o rec\n"
      "  rangecal calibrate rec && rangecal diagnose rec");
  return [given] {
    check_table_options(*given);
    return TableImport(*given, read_file(given->source), TableImport::Holds::truth_and_reading).pairs();
  };
}

const bool kCsvKnown =
    know_importer({"csv", "any table with a column of true distances and one of readings", add_csv});

}  // namespace

bool TableOptions::says_something() const {
  const auto texts = {truth,     reading,      batch,        landmark,  bearing,   time,    unit,
                      true_unit, reading_unit, bearing_unit, time_unit, separator, decimal, name};
  return skip != 0 || !missing.empty() ||
         std::any_of(texts.begin(), texts.end(), [](const std::string& text) { return !text.empty(); });
}

void add_table_options(CLI::App& command, TableOptions& given, const std::string& group) {
  const auto option = [&](const char* name, auto& value, const char* what) {
    CLI::Option* added = command.add_option(name, value, what);
    if (!group.empty()) added->group(group);
    return added;
  };
  option("--reading", given.reading, "name of the column with what the sensor read");
  option("--batch", given.batch, "column of labels: readings of one fixed distance belong together");
  option("--landmark", given.landmark,
         "column of labels: which target or surface was read, or which of several sensors read it");
  option("--bearing", given.bearing, "column of the direction in the sensor's frame");
  option("--time", given.time, "column of times: numbers, or as ISO 8601 has them (2024-05-01T12:00:00.5)");
  option("--unit", given.unit, "of distances and readings: m, mm, cm, um, km, in, ft or yd");
  option(
      "--reading-unit", given.reading_unit,
      "of the readings alone; V, mV, counts, ticks, us, raw, ... are no lengths: such readings stay as they are");
  option("--bearing-unit", given.bearing_unit, "rad, deg or mrad");
  option("--time-unit", given.time_unit, "of times that are numbers: s, ms, us, ns, min or h");
  option("--separator", given.separator, "comma, semicolon, tab or bar, where it is not told rightly");
  option("--decimal", given.decimal, "comma or point, where 1,234 may be either");
  option("--missing", given.missing, "a text that stands for no value, such as ERR; may be given again")
      ->allow_extra_args(false);
  option("--skip", given.skip, "lines above the header row")->capture_default_str();
}

ReadingsTable read_readings(TableOptions given, std::string text) {
  check_table_options(given);
  return TableImport(given, std::move(text), TableImport::Holds::reading).readings();
}

}  // namespace rangecal::ingest
