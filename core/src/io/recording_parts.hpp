// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/core/yaml_reader.hpp"

namespace rangecal::io {

std::string path_in(const std::string& folder, const char* file);

/// Where the files of a recording come from: a folder, or texts in memory.
class Files {
 public:
  explicit Files(std::string folder) : folder_(std::move(folder)) {}
  explicit Files(const std::map<std::string, std::string>& texts) : texts_(&texts) {}

  std::string name(const char* file) const;   ///< as messages call it
  bool has(const char* file) const;
  CsvTable table(const char* file) const;     ///< throws InputError where it is missing or malformed
  YamlReader yaml(const char* file) const;    ///< the same

 private:
  const std::string& text(const char* file) const;
  std::string folder_;
  const std::map<std::string, std::string>* texts_ = nullptr;
};

/// Labels in their order, and back.
class LabelIndex {
 public:
  std::optional<int> find(const std::string& label) const {
    const auto found = indices_.find(label);
    return found == indices_.end() ? std::nullopt : std::optional<int>(found->second);
  }
  /// The index of the label, new or not.
  int insert(const std::string& label) {
    return indices_.emplace(label, static_cast<int>(indices_.size())).first->second;
  }
  std::size_t size() const { return indices_.size(); }

 private:
  std::map<std::string, int> indices_;
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
  std::vector<TapedDistance> taped;
};

/// All files of a recording, whatever its kind.
Recording read_recording(const Files& files);

/// recording.yaml into the recording's sensor, kind and stop model.
RecordingHeader read_header(const Files& files, Recording& recording);

/// landmarks.csv where it exists; says whether it does. Only landmarks in it may then be observed.
bool read_landmark_list(const Files& files, const RecordingHeader& header, Recording& recording,
                        LabelIndex& index);
/// The landmark of a reading: known, or new where there is no landmarks.csv.
int observed_landmark(const CsvTable& table, std::size_t row, std::size_t column, bool listed, double radius_m,
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

/// Why a range reading cannot be used: a key of Counts::dropped, or nullptr.
const char* unusable(const Sensor& sensor, const std::optional<double>& range_m);
bool lost_at_limit(const char* reason);

/// How many readings a cell had, and how many of them the sensor's limits took.
struct CellLoss {
  int seen = 0, lost = 0;
  bool cut() const { return lost > 0 && 100.0 * lost > seen; }
};

/// Numeric columns that are not among `known`, ready to be filled.
struct CovariateColumns {
  std::vector<std::size_t> columns;
  std::vector<std::vector<double>*> values;

  CovariateColumns(const CsvTable& table, std::initializer_list<const char*> known, Covariates& covariates);
  void append(const CsvTable& table, std::size_t row);
};

}  // namespace rangecal::io
