// SPDX-License-Identifier: BSD-3-Clause
#include "io/recording_parts.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <numbers>

#include "io/csv_fields.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"

namespace rangecal {

Recording load_recording(const std::string& folder, const LoadOptions& options) {
  std::error_code error;
  if (!std::filesystem::exists(folder, error)) throw InputError(folder, 0, "", "no such folder");
  if (!std::filesystem::is_directory(folder, error)) throw InputError(folder, 0, "", "is not a folder");
  Recording recording = io::read_recording(io::Files(folder), options);
  recording.path = folder;
  return recording;
}

std::vector<Recording> load_recordings(const std::vector<std::string>& folders, const LoadOptions& options) {
  require_distinct(folders);
  std::vector<std::string> tables;
  for (const std::string& folder : folders)
    for (const char* name : reading_tables) tables.push_back(io::path_in(folder, name));
  require_distinct(tables);
  std::vector<Recording> recordings;
  recordings.reserve(folders.size());
  for (const std::string& folder : folders) recordings.push_back(load_recording(folder, options));
  return recordings;
}

Recording parse_recording(const std::map<std::string, std::string>& files, const LoadOptions& options) {
  return io::read_recording(io::Files(files), options);
}

namespace io {

std::string path_in(const std::string& folder, const char* file) {
  return (std::filesystem::path(folder) / file).string();
}

std::string Files::name(const char* file) const { return texts_ ? file : path_in(folder_, file); }

bool Files::has(const char* file) const { return texts_ ? texts_->contains(file) : file_exists(name(file)); }

const std::string& Files::text(const char* file) const {
  const auto found = texts_->find(file);
  if (found == texts_->end()) throw InputError(file, 0, "", "is missing");
  return found->second;
}

CsvTable Files::table(const char* file) const {
  return texts_ ? CsvTable::parse(text(file), file) : CsvTable::read(name(file));
}

CsvRows Files::rows(const char* file) const {
  return texts_ ? CsvRows::parse(text(file), file) : CsvRows::open(name(file));
}

YamlReader Files::yaml(const char* file) const {
  return texts_ ? YamlReader::parse(text(file), file) : YamlReader::open(name(file));
}

Recording read_recording(const Files& files, const LoadOptions& options) {
  Recording recording;
  const RecordingHeader header = read_header(files, recording);
  if (!options.group_by.empty()) recording.groups.by = options.group_by;
  if (const std::string& unit = recording.sensor.unit; !unit.empty())
    recording.notes.emplace_back(
        InputError(header.file, 0, "",
                   "the readings are in " + unit +
                       ", no lengths: where the curve, the noise and errors of readings are said "
                       "to be in m, " +
                       unit + " is meant")
            .what());
  if (recording.kind == RecordingKind::pairs) {
    read_pairs_kind(files, header, recording);
  } else {
    read_landmarks_kind(files, header, recording);
  }
  return recording;
}

bool read_landmark_list(const Files& files, const RecordingHeader& header, Recording& recording,
                        LabelIndex& index) {
  if (!files.has("landmarks.csv")) return false;
  const CsvTable table = files.table("landmarks.csv");
  const std::size_t label = table.require("landmark");
  const auto radius = table.optional("radius_m");
  const auto reflectance = table.optional("reflectance");
  for (std::size_t row = 0; row < table.rows(); ++row) {
    Landmark landmark;
    landmark.label = table.label(row, label);
    landmark.radius_m = header.landmark_radius_m;
    if (index.find(landmark.label))
      table.fail(row, label, "landmark '" + landmark.label + "' is listed twice");
    if (radius && table.number(row, *radius)) {
      landmark.radius_m = table.finite(row, *radius);
      if (landmark.radius_m < 0.0) table.fail(row, *radius, "is negative");
    }
    if (reflectance && table.number(row, *reflectance))
      landmark.reflectance = table.finite(row, *reflectance);
    index.insert(landmark.label);
    recording.landmarks.push_back(std::move(landmark));
  }
  return true;
}

int observed_landmark(const CsvRows& rows, std::size_t column, bool listed, double radius_m,
                      Recording& recording, LabelIndex& index) {
  const std::string_view label = rows.label(column);
  if (const auto known = index.find(label)) return *known;
  if (listed)
    rows.fail(column, "unknown landmark '" + std::string(label) + "': landmarks.csv does not list it");
  if (index.size() == LabelIndex::most)
    rows.fail(column, "there are more than " + std::to_string(LabelIndex::most));
  recording.landmarks.push_back({std::string(label), radius_m, std::nullopt});
  return index.insert(label);
}

namespace {

constexpr const char* degrees = " is beyond +-2 pi rad: degrees, most likely; convert to radians";

bool in_turns(double angle) { return std::abs(angle) <= 2.0 * std::numbers::pi; }

}  // namespace

double checked_angle(const CsvTable& table, std::size_t row, std::size_t column, double angle) {
  if (!in_turns(angle)) table.fail(row, column, "'" + std::string(table.text(row, column)) + "'" + degrees);
  return wrap_angle(angle);
}

double checked_angle(const CsvRows& rows, std::size_t column, double angle) {
  if (!in_turns(angle)) rows.fail(column, "'" + std::string(rows.text(column)) + "'" + degrees);
  return wrap_angle(angle);
}

const char* unusable(const Sensor& sensor, const std::optional<double>& range_m) {
  if (!range_m) return "missing";
  if (!std::isfinite(*range_m)) return "not finite";
  if (*range_m == 0.0) return "zero";
  if (*range_m < 0.0) return "negative";
  if (*range_m < sensor.range_min_m) return "below range_min_m";
  if (*range_m > sensor.range_max_m) return "above range_max_m";
  return nullptr;
}

bool lost_at_limit(const char* reason) {
  return reason != nullptr &&
         (std::string_view(reason).starts_with("below") || std::string_view(reason).starts_with("above"));
}

CovariateColumns::CovariateColumns(const CsvRows& rows, std::initializer_list<const char*> known,
                                   const std::vector<std::string>& grouping) {
  for (std::size_t column = 0; column < rows.columns().size(); ++column) {
    const std::string& name = rows.columns()[column];
    const bool is_known =
        std::any_of(known.begin(), known.end(), [&](const char* other) { return name == other; });
    if (name.empty() || is_known) continue;
    columns_.push_back({column, std::find(grouping.begin(), grouping.end(), name) != grouping.end()});
    names_.push_back(name);
  }
}

void CovariateColumns::take(const CsvRows& rows, bool used) {
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    Column& own = columns_[i];
    if (!own.numeric) continue;
    double value = std::numeric_limits<double>::quiet_NaN();
    const std::string_view field = rows.text(own.column);
    const Parsed parsed = parse_number(field, value);
    own.any = own.any || parsed == Parsed::number;
    if (const std::string fault = number_fault(field, parsed); !fault.empty()) {
      own.numeric = false;
      own.values = {};
      if (!own.grouping)
        texts_.emplace_back(
            InputError(rows.file(), rows.line(), names_[i], fault + "; the column is left out").what());
    } else if (used) {
      own.values.push_back(value);
    }
  }
}

Covariates CovariateColumns::finish(const std::vector<char>& unwanted, std::vector<std::string>& notes) {
  constexpr std::size_t most = 8;  // of a table of remarks, not all need naming
  notes.insert(notes.end(), texts_.begin(),
               texts_.begin() + static_cast<long>(std::min(most, texts_.size())));
  if (texts_.size() > most)
    notes.back() += "; so are " + std::to_string(texts_.size() - most) + " more that hold texts";
  Covariates covariates;
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    if (!columns_[i].numeric || !columns_[i].any) continue;
    leave_out(unwanted, columns_[i].values);
    covariates[names_[i]] = std::move(columns_[i].values);
  }
  return covariates;
}

GroupColumns::GroupColumns(const CsvRows& rows, const Groups& groups) {
  for (const std::string& name : groups.by) columns_.push_back(rows.require(name));
}

void GroupColumns::take(const CsvRows& rows, bool used) {
  if (columns_.empty() || !used) return;
  std::vector<std::string> texts;
  for (const std::size_t column : columns_) texts.emplace_back(rows.text(column));
  const auto [known, is_new] = known_.try_emplace(std::move(texts), static_cast<int>(known_.size()));
  if (is_new) labels_.push_back(known->first);
  of_.push_back(known->second);
}

void GroupColumns::finish(const std::vector<char>& unwanted, Groups& groups) {
  leave_out(unwanted, of_);
  std::vector<int> number(labels_.size(), -1);
  for (int& group : of_) {
    const auto old = static_cast<std::size_t>(group);
    if (number[old] < 0) {
      number[old] = static_cast<int>(groups.labels.size());
      groups.labels.push_back(labels_[old]);
    }
    group = number[old];
  }
  groups.of = std::move(of_);
}

}  // namespace io
}  // namespace rangecal
