// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <memory>
#include <string>
#include <vector>

#include "commands.hpp"
#include "ingest/importer.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

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
  return done;
}

}  // namespace

void add_import(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand("import", "turn a published data set into a recording");
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
      "Example:\n"
      "  rangecal import lego brenner-lego -o rec && rangecal diagnose rec");
}

}  // namespace rangecal::app
