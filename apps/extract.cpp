// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "commands.hpp"
#include "ingest/bags/bag_scans.hpp"
#include "ingest/extract_options.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "read_progress.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

/// Throws InputError for results that would take the place of what is read or measured, or cannot be written.
void check_results(const std::vector<std::string>& inputs, const std::string& folder,
                   const std::string& json) {
  std::vector<std::string> outputs = recording_files({folder});
  outputs.insert(outputs.end(), {folder + "/extraction.json", json});
  require_apart(outputs, inputs);
  require_writable(json);
  require_replaceable(folder);
}

int list_topics(const std::vector<std::string>& bags) {
  for (const std::string& bag : bags) {
    const std::string text = ingest::describe_topics(bag);
    fmt::print("{}{}", bags.size() > 1 ? bag + "\n" : std::string(), text);
  }
  return done;
}

int save(ingest::Extracted extracted, const std::string& folder, const std::string& json) {
  Extraction& extraction = extracted.extraction;
  for (const std::string& warning : extracted.warnings) fmt::print(stderr, "rangecal: {}\n", warning);
  const std::string counts = ingest::extraction_json(extraction, extracted.options);
  fmt::print("scans of   {} ({})\n", extracted.source, extracted.format);
  fmt::print("{}", ingest::describe(extraction, extracted.options));
  if (!json.empty()) write_file(json, counts);
  if (extraction.runs_clockwise)
    fmt::print(
        stderr,
        "rangecal: with bearings turned round the stops agree much better: if the scanner counts clockwise, "
        "add --clockwise\n");
  if (extraction.recording.landmarks.empty()) {
    fmt::print(stderr, "rangecal: no landmark was found; no recording is written\n");
    return not_delivered;
  }
  save_recording(extraction.recording, folder, "rangecal extract");
  write_file(folder + "/extraction.json", counts);
  extraction.recording.path = folder;
  fmt::print("\n{}\n", describe({&extraction.recording, 1}));
  return done;
}

}  // namespace

void add_extract(CLI::App& app, Action& chosen) {
  CLI::App* command =
      app.add_subcommand("extract", "find cylinders in raw scans and make a recording of them");
  const auto folder = std::make_shared<std::string>(), json = std::make_shared<std::string>();
  const auto work = ingest::add_extract_options(*command, progress_on_terminal());
  const auto topics = std::make_shared<bool>(false);
  CLI::Option* output =
      command->add_option("-o,--output", *folder, "folder of the recording, made if missing");
  command->add_option("--json", *json, "write what was found and thrown away, also without a recording");
  command->add_flag("--topics", *topics, "say what topics the bags hold, and stop")->group("Bags");
  command->footer(
      "Nothing is dropped silently: scans, beams, segments and cylinders are counted with the reason, here and in\n"
      "extraction.json beside the recording. Exit code 1: no landmark was found.\n"
      "Examples:\n"
      "  rangecal extract run.csv --stops stops.csv --radius 0.12 -o rec     the log is split where the robot stands\n"
      "  rangecal extract s1.csv s2.csv s3.csv --stops stops.csv --radius 0.04,0.12 -o rec      one file for each "
      "stop\n"
      "  zcat robot.log.gz | rangecal extract - --error random_walk -o rec\n"
      "  rangecal extract robot.log --error random_walk -o rec      CARMEN log: poses from its odometry\n"
      "  rangecal extract run.csv --stops stops.csv --radius 0.12 --arc mean -o rec      to see what arc_definition "
      "costs\n"
      "  rangecal extract run.mcap --topics      what a bag holds\n"
      "  rangecal extract run.mcap --scan /scan --odom /odom --radius 0.06 -o rec      stops where the robot stands, poses "
      "by /odom\n"
      "  rangecal extract rosbag2_folder --odom /tf --frames odom,base_link --radius 0.06 -o rec      poses by transforms");
  command->callback([=, &chosen] {
    if (*topics) {
      chosen = [=] { return list_topics(command->get_option("SCANS")->results()); };
      return;
    }
    if (output->count() == 0) throw CLI::RequiredError("--output");
    chosen = [=] {
      check_results(ingest::extract_inputs(*command), *folder, *json);
      return save(work(), *folder, *json);
    };
  });
}

}  // namespace rangecal::app
