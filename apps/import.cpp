// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cctype>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "commands.hpp"
#include "ingest/importer.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

/// As a shell takes it for one word.
std::string shell_word(const std::string& text) {
  const bool plain = std::all_of(text.begin(), text.end(), [](unsigned char c) {
    return std::isalnum(c) ||
           std::string_view("/._-+=:,@%").find(static_cast<char>(c)) != std::string_view::npos;
  });
  if (plain && !text.empty()) return text;
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

int save(ingest::Imported imported, const std::string& folder) {
  require_replaceable(folder);
  for (const std::string& warning : imported.warnings) fmt::print(stderr, "rangecal: {}\n", warning);
  std::vector<std::string> outputs = recording_files({folder});
  outputs.push_back(folder + "/extraction.json");
  require_apart(outputs, imported.inputs);
  save_recording(imported.recording, folder, "rangecal import");
  if (!imported.extraction_json.empty()) write_file(folder + "/extraction.json", imported.extraction_json);
  imported.recording.path = folder;
  fmt::print("{}{}\n", imported.words, describe({&imported.recording, 1}));
  const std::string word = shell_word(folder);
  fmt::print("Next       rangecal calibrate {0}\n           rangecal diagnose {0}\n", word);
  return done;
}

}  // namespace

void add_import(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand("import", "turn a table or a published data set into a recording");
  command->require_subcommand(1);
  for (const ingest::Importer& importer : ingest::importers()) {
    CLI::App* own = command->add_subcommand(importer.name, importer.what);
    const auto folder = std::make_shared<std::string>();
    const auto work = importer.add(*own);
    own->add_option("-o,--output", *folder, "folder of the recording, made if missing")->required();
    own->callback([work, folder, &chosen] { chosen = [work, folder] { return save(work(), *folder); }; });
  }
  command->footer(
      "Nothing is corrected: outliers, latencies and everything a calibration has to find stay in.\n"
      "'rangecal import FORMAT --help' says where the data are and which choices there are.\n"
      "Examples:\n"
      "  rangecal import csv readings.csv --true 'distance [cm]' --reading sonar --unit cm -o rec\n"
      "  rangecal import lego brenner-lego -o rec && rangecal diagnose rec");
}

}  // namespace rangecal::app
