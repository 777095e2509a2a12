// SPDX-License-Identifier: BSD-3-Clause
#include "import/importer.hpp"

namespace rangecal::app {

void add_import(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand("import", "turn a published data set into a recording");
  command->require_subcommand(1);
  for (const Importer& importer : importers())
    importer.add(*command->add_subcommand(importer.name, importer.what), chosen);
  command->footer(
      "Nothing is corrected: outliers, latencies and everything a calibration has to find stay in.\n"
      "'rangecal import FORMAT --help' says where the data are and which choices there are.");
}

}  // namespace rangecal::app
