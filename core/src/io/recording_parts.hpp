// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "rangecal/core/csv_rows.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/core/yaml_reader.hpp"

namespace rangecal::io {

std::string path_in(const std::string& folder, const char* file);

/// Where the files of a recording come from: a folder, or texts in memory.
class Files {
 public:
  explicit Files(std::string folder) : folder_(std::move(folder)) {}
  explicit Files(const std::map<std::string, std::string>& texts) : texts_(&texts) {}

  std::string name(const char* file) const;  ///< as messages call it
  bool has(const char* file) const;
  CsvTable table(const char* file) const;   ///< throws InputError where it is missing or malformed
  CsvRows rows(const char* file) const;     ///< the same
  YamlReader yaml(const char* file) const;  ///< the same

 private:
  const std::string& text(const char* file) const;
  std::string folder_;
  const std::map<std::string, std::string>* texts_ = nullptr;
};

/// Labels in their order, and back.
class LabelIndex {
 public:
  static constexpr std::size_t most = 10'000'000;  ///< so that no file of labels takes all memory

  std::optional<int> find(std::string_view label) const {
    const auto found = indices_.find(label);
    return found == indices_.end() ? std::nullopt : std::optional<int>(found->second);
  }
  /// The index of the label, new or not.
  int insert(std::string_view label) {
    if (const auto known = find(label)) return *known;
    const int index = static_cast<int>(indices_.size());
    indices_.emplace(label, index);
    return index;
  }
  std::size_t size() const { return indices_.size(); }

 private:
  struct Hash : std::hash<std::string_view> {
    using is_transparent = void;
  };
  std::unordered_map<std::string, int, Hash, std::equal_to<>> indices_;
};

/// A taped distance as recording.yaml states it, before the landmarks are known.
struct TapedDistance {
  std::string from, to;
  double distance_m = 0.0, sigma_m = 0.0;
  int line = 0;
  std::string field;
};

/// What recording.yaml says besides what goes into Recording at once.
struct RecordingHeader {
  std::string file;
  double landmark_radius_m = 0.0;
  double reference_offset_s = 0.0;  ///< a reading at time t belongs to the true distance at t + this
  int reference_line = 0;
  std::vector<TapedDistance> taped;
};

/// All files of a recording, whatever its kind.
Recording read_recording(const Files& files, const LoadOptions& options);

/// recording.yaml into the recording's sensor, kind and stop model.
RecordingHeader read_header(const Files& files, Recording& recording);

/// landmarks.csv where it exists; says whether it does. Only landmarks in it may then be observed.
bool read_landmark_list(const Files& files, const RecordingHeader& header, Recording& recording,
                        LabelIndex& index);
/// The landmark of a reading: known, or new where there is no landmarks.csv.
int observed_landmark(const CsvRows& rows, std::size_t column, bool listed, double radius_m,
                      Recording& recording, LabelIndex& index);

/// stops.csv, observations.csv and the truth files.
void read_landmarks_kind(const Files& files, const RecordingHeader& header, Recording& recording);
/// truth_stops.csv and truth_landmarks.csv where they exist.
void read_truth(const Files& files, bool listed, const LabelIndex& stops, const LabelIndex& landmarks,
                Recording& recording);
/// pairs.csv.
void read_pairs_kind(const Files& files, const RecordingHeader& header, Recording& recording);

/// A bearing or heading [rad] wrapped to (-pi, pi]; beyond +-2 pi it throws: degrees, most likely.
double checked_angle(const CsvTable& table, std::size_t row, std::size_t column, double angle);
double checked_angle(const CsvRows& rows, std::size_t column, double angle);

/// Why a range reading cannot be used: a key of Counts::dropped, or nullptr.
const char* unusable(const Sensor& sensor, const std::optional<double>& range_m);
bool lost_at_limit(const char* reason);

/// How many readings a cell had, and how many of them the sensor's limits took.
struct CellLoss {
  int seen = 0, lost = 0;
  void count(const char* reason) {  // of a reading that cannot be used, or nullptr
    if (reason != nullptr && !lost_at_limit(reason)) return;
    ++seen;
    lost += reason != nullptr;
  }
  bool cut() const { return lost > 0 && 100.0 * lost > seen; }
};

/// Numeric columns that are not among `known`, as their rows come: of at least one number, all others empty. A column
/// that holds a text is left out, with a note that says which text and where unless it is one of `grouping`.
class CovariateColumns {
 public:
  CovariateColumns(const CsvRows& rows, std::initializer_list<const char*> known,
                   const std::vector<std::string>& grouping);
  void take(const CsvRows& rows, bool used);  ///< the current row; kept where it is used
  /// Leaves out what stands for a reading that is not wanted (one per reading used), gives the columns away and adds
  /// the notes.
  Covariates finish(const std::vector<char>& unwanted, std::vector<std::string>& notes);

 private:
  struct Column {
    std::size_t column;
    bool grouping = false, numeric = true, any = false;
    std::vector<double> values{};
  };
  std::vector<Column> columns_;
  std::vector<std::string> names_,
      texts_;  ///< texts_: a note for each column left out, by the first text found
};

/// The group of every reading by the texts of the columns `recording.groups.by`, as their rows come. Throws where there is
/// no such column.
class GroupColumns {
 public:
  GroupColumns(const CsvRows& rows, const Groups& groups);
  void take(const CsvRows& rows, bool used);  ///< the current row; kept where it is used
  /// Leaves out what stands for a reading that is not wanted, and numbers the groups that are left.
  void finish(const std::vector<char>& unwanted, Groups& groups);

 private:
  std::vector<std::size_t> columns_;
  std::map<std::vector<std::string>, int> known_;
  std::vector<std::vector<std::string>> labels_;
  std::vector<int> of_;
};

/// Leaves out the values whose reading is not wanted; nothing where `unwanted` is empty or the column is.
template <typename Value>
void leave_out(const std::vector<char>& unwanted, std::vector<Value>& values) {
  if (unwanted.empty() || values.empty()) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!unwanted[i]) values[kept++] = values[i];
  values.resize(kept);
}

}  // namespace rangecal::io
