// SPDX-License-Identifier: BSD-3-Clause
#include "fuzz/readers.hpp"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <span>
#include <stdexcept>

#include "ingest/bags/bag_correction.hpp"
#include "ingest/bags/bag_scans.hpp"
#include "ingest/bags/message_source.hpp"
#include "ingest/bags/ros_messages.hpp"
#include "ingest/importer.hpp"
#include "ingest/scan_files.hpp"
#include "proof/journal.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/csv_rows.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/core/utf8.hpp"
#include "rangecal/problems/world/scene.hpp"
#include "rangecal/solvers/diagnosis/simulation_model.hpp"
#include "rangecal/solvers/fleet/population.hpp"
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"
#include "rangecal/solvers/study/study.hpp"
#include "study/journal.hpp"
#include "support/scan_logs.hpp"
#include "track/tracking.hpp"

namespace rangecal::fuzz {
namespace {

namespace fs = std::filesystem;

void promise(bool kept, const char* what) {
  if (!kept) throw std::logic_error(what);
}

/// A folder in memory for the readers that take a path.
class Folder {
 public:
  Folder() : path_(fs::path("/dev/shm") / ("rangecal-fuzz-" + std::to_string(::getpid()))) {
    fs::create_directories(path_);
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  std::string file(const std::string& name) const { return (path_ / name).string(); }
  std::string write(const std::string& name, std::string_view bytes) const {
    std::ofstream(file(name), std::ios::binary)
        .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    return file(name);
  }
  void clear() const {
    for (const auto& entry : fs::directory_iterator(path_)) fs::remove_all(entry.path());
  }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

const Folder& folder() {
  static const Folder own;
  return own;
}

std::map<std::string, std::string> files_in(std::string_view bytes) {
  std::map<std::string, std::string> files;
  constexpr std::string_view mark = "=== ";
  while (!bytes.empty()) {
    std::size_t end = bytes.find("\n=== ");
    end = end == std::string_view::npos ? bytes.size() : end + 1;
    std::string_view part = bytes.substr(0, end);
    bytes.remove_prefix(end);
    if (!part.starts_with(mark)) continue;
    const std::size_t line = std::min(part.find('\n'), part.size());
    const std::string name(part.substr(mark.size(), line - mark.size()));
    files[name] = std::string(part.substr(std::min(line + 1, part.size())));
  }
  return files;
}

void feed_recording(std::string_view bytes) {
  const Recording recording = parse_recording(files_in(bytes));
  const std::size_t count = recording.readings.size() + recording.pairs.size();
  promise(static_cast<std::size_t>(recording.counts.used) == count, "readings used and held differ");
  for (const int stop : recording.readings.stop)
    promise(stop >= 0 && static_cast<std::size_t>(stop) < recording.stops.size(), "a reading of no stop");
  for (const auto* landmarks : {&recording.readings.landmark, &recording.pairs.landmark})
    for (const int landmark : *landmarks)
      promise(landmark >= 0 && static_cast<std::size_t>(landmark) < recording.landmarks.size(),
              "of no landmark");
  for (const auto* covariates : {&recording.readings.covariates, &recording.pairs.covariates})
    for (const auto& [name, values] : *covariates)
      promise(values.size() == count, "a covariate of another length");
}

/// What is read reads back as the same, once with every field quoted: libcsv, and the quick way for lines
/// without quotes.
void feed_csv(std::string_view bytes) {
  const CsvTable table = CsvTable::parse(std::string(bytes), "t.csv");
  const auto quoted = [](std::string_view text) {
    std::string field = "\"";
    for (const char c : text) field += c == '"' ? "\"\"" : std::string(1, c);
    return field + "\"";
  };
  for (const bool quotes : {false, true}) {
    std::string text;
    const auto add = [&](std::string_view field, std::size_t column) {
      text += column == 0 ? "" : ",";
      text += quotes || (table.columns().size() == 1 && field.empty()) ? quoted(field)
                                                                       : csv_field(std::string(field));
    };
    for (std::size_t c = 0; c < table.columns().size(); ++c) add("c" + std::to_string(c), c);
    for (std::size_t r = 0; r < table.rows(); ++r) {
      text += "\n";
      for (std::size_t c = 0; c < table.columns().size(); ++c) add(table.text(r, c), c);
    }
    const CsvTable again = CsvTable::parse(text + "\n", "t.csv");
    promise(again.rows() == table.rows(), "another number of rows");
    for (std::size_t r = 0; r < table.rows(); ++r)
      for (std::size_t c = 0; c < table.columns().size(); ++c)
        promise(again.text(r, c) == table.text(r, c), "another field");
  }
  for (std::size_t r = 0; r < table.rows(); ++r) {
    const std::string label(table.text(r, 0));
    const CsvTable one = CsvTable::parse("a,b\n" + csv_label(label) + ",\n", "t.csv");
    promise(label.empty() || one.label(0, 0) == label, "another label");
  }
}

void feed_scene(std::string_view bytes) { parse_scene(std::string(bytes), "scene.yaml", SceneScope::any); }

void feed_study(std::string_view bytes) {
  static const bool once = [] {
    for (const char* scene : {"field-layout.yaml", "pairs-2016.yaml"})
      fs::copy_file(fs::path(RANGECAL_SOURCE_DIR) / "notebooks_data/scenes" / scene, folder().path() / scene,
                    fs::copy_options::overwrite_existing);
    return true;
  }();
  (void)once;
  load_study(folder().write("study.yaml", bytes));
}

void feed_calibration(std::string_view bytes) {
  const std::string file = folder().write("calibration.json", bytes);
  for (const Calibration& calibration : load_calibrations(file)) calibrations_to_json({calibration});
}

void feed_diagnosis(std::string_view bytes) {
  simulation_model_from_json(std::string(bytes), "diagnosis.json");
}

void feed_population(std::string_view bytes) { population_from_json(std::string(bytes), "population.json"); }

void feed_calibrator(std::string_view bytes) {
  RecursiveCalibrator state = RecursiveCalibrator::from_json(std::string(bytes), "state.json");
  promise(!state.to_json().empty(), "a state that cannot be written");
  state.approximate();
}

/// A stream with the state of an earlier run, both as files: "=== state.json", "=== stream.csv".
void feed_track(std::string_view bytes) {
  const auto files = files_in(bytes);
  const auto text = [&](const char* name) { return files.contains(name) ? files.at(name) : std::string(); };
  app::TrackJob job;
  job.input = folder().write("stream.csv", text("stream.csv"));
  job.output = folder().write("out.csv", std::string(4096, ' '));
  job.state = folder().file("state.json");
  if (files.contains("state.json")) folder().write("state.json", text("state.json"));
  struct Gone {
    std::string path;
    ~Gone() { fs::remove(path); }
  } gone{job.state};
  app::track(job);
}

void feed_scans(std::string_view bytes) {
  const auto source = ingest::open_scan_file(folder().write("scans", bytes), {}, 1000);
  for (const Scan& scan : test::whole_log(*source).scans)
    promise(scan.bearing_rad.size() == scan.range_m.size(), "bearings and ranges differ");
}

/// What `rangecal import NAME WORDS...` reads.
void import_by(const std::string& name, const std::vector<std::string>& words) {
  for (const ingest::Importer& importer : ingest::importers()) {
    if (importer.name != name) continue;
    CLI::App command;
    const auto work = importer.add(command);
    command.parse(std::vector<std::string>(words.rbegin(), words.rend()));
    const ingest::Imported imported = work();
    promise(imported.recording.counts.read >= 0 && first_bad_byte(imported.words) == std::string_view::npos,
            "words that are not UTF-8");
  }
}

/// A table, once with its columns found by name and once by options.
void feed_table(std::string_view bytes) {
  const std::string path = folder().write("table.csv", bytes);
  try {
    import_by("csv", {path});
  } catch (const InputError&) {
  }
  import_by("csv", {path, "--true", "truth", "--reading", "sonar", "--time", "time", "--landmark", "which"});
}

/// A bag with its scans corrected: every reading becomes something, and what is written reads back.
void correct_scans(const std::string& file, const std::string& name) {
  static const Calibration line = [] {
    Calibration c;
    c.outcome = Outcome::converged;
    c.alpha = Eigen::Vector2d(0.05, 0.98);
    c.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 0.01)};
    c.range_min_m = 0.3, c.range_max_m = 5.0;
    return c;
  }();
  ingest::BagCorrectionOptions correction;
  correction.topic = "/scan", correction.keep_raw = "/scan_raw";
  const std::string out = (folder().path() / ("corrected-" + name)).string();
  const ingest::BagCorrected corrected = ingest::correct_bag(line, "cal.json", file, out, correction);
  promise(corrected.readings == corrected.corrected + corrected.kept + corrected.without_distance,
          "readings that became nothing");
  std::uint64_t scans = 0;
  for (const ingest::BagTopic& topic : ingest::open_bag(out)->topics())
    if (topic.name == "/scan") scans += topic.messages;
  promise(scans == corrected.messages - corrected.left_out, "another number of scans was written");
  fs::remove(out);
}

/// Everything that is read of a bag; a refusal of one does not keep the other from being tried.
void feed_bag(std::string_view bytes, const char* name) {
  const std::string file = folder().write(name, bytes);
  std::string refusal;
  try {
    ingest::describe_topics(file);
    correct_scans(file, name);
  } catch (const InputError& error) {
    refusal = error.what();
  }
  for (const char* odometry : {"/odom", "/tf"})
    for (const Scan& scan : test::read_bag_scans(file, {"/scan", odometry, "", {}}).scans) {
      promise(scan.bearing_rad.size() == scan.range_m.size(), "bearings and ranges differ");
      promise(scan.odometry.has_value(), "a scan without odometry");
    }
  if (!refusal.empty()) throw InputError(refusal);
}
void feed_mcap(std::string_view bytes) { feed_bag(bytes, "a.mcap"); }
void feed_sqlite(std::string_view bytes) { feed_bag(bytes, "a.db3"); }

/// The first byte says which message, and of which release.
void feed_message(std::string_view bytes) {
  if (bytes.empty()) return;
  const auto which = static_cast<unsigned char>(bytes.front());
  const std::span<const std::byte> message = std::as_bytes(std::span(bytes.substr(1)));
  const ingest::Wire wire = which % 2 != 0 ? ingest::Wire::ros1 : ingest::Wire::cdr;
  if (which / 2 % 5 == 0) ingest::read_laser_scan(message, wire);
  if (which / 2 % 5 == 1)
    promise(std::isfinite(ingest::read_odometry(message, wire).pose.heading_rad), "no heading");
  if (which / 2 % 5 == 2) ingest::read_transforms(message, wire);
  if (which / 2 % 5 == 3) ingest::read_range(message, wire);
  if (which / 2 % 5 == 4) ingest::read_pose_stamped(message, wire);
}

/// The files of a published data set.
void feed_import(std::string_view bytes, const char* importer_name) {
  const fs::path data = folder().path() / importer_name;
  fs::create_directories(data);
  for (const auto& [name, text] : files_in(bytes))
    if (name.find('/') == std::string::npos && !name.empty() && name.size() < 64 &&
        name.find('\0') == std::string::npos)
      folder().write(std::string(importer_name) + "/" + name, text);
  struct Gone {
    fs::path path;
    ~Gone() { fs::remove_all(path); }
  } gone{data};
  std::vector<std::string> words{data.string()};
  if (std::string_view(importer_name) == "mrclam")
    words.insert(words.begin(), {"--robot", "1", "--as", bytes.size() % 2 ? "pairs" : "stops"});
  import_by(importer_name, words);
}

void feed_mrclam(std::string_view bytes) { feed_import(bytes, "mrclam"); }
void feed_lego(std::string_view bytes) { feed_import(bytes, "lego"); }

void feed_journal(std::string_view bytes) {
  app::from_journal_line(std::string(bytes));
  proof::read_scores(std::string(bytes), "scores.csv");
}

}  // namespace

const std::vector<Reader>& readers() {
  static const std::vector<Reader> all = {{"recording", feed_recording},
                                          {"csv", feed_csv},
                                          {"scene", feed_scene},
                                          {"study", feed_study},
                                          {"calibration", feed_calibration},
                                          {"diagnosis", feed_diagnosis},
                                          {"population", feed_population},
                                          {"calibrator", feed_calibrator},
                                          {"track", feed_track},
                                          {"scans", feed_scans},
                                          {"bag", feed_scans},
                                          {"mcap", feed_mcap},
                                          {"sqlite", feed_sqlite},
                                          {"message", feed_message},
                                          {"mrclam", feed_mrclam},
                                          {"lego", feed_lego},
                                          {"table", feed_table},
                                          {"journal", feed_journal}};
  return all;
}

std::string feed(const Reader& reader, std::string_view bytes) {
  try {
    reader.feed(bytes);
  } catch (const InputError& error) {
    const std::string line = error.what();
    promise(!line.empty() && line.find('\n') == std::string::npos && line.size() <= 2000, "not one line");
    promise(first_bad_byte(line) == std::string_view::npos, "not UTF-8");
    return line;
  }
  return "";
}

}  // namespace rangecal::fuzz
