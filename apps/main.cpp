// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <sstream>
#include <string>
#include <system_error>

#include "commands.hpp"
#include "logging.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/version.hpp"

namespace {

using namespace rangecal;

void complain(const std::string& what) { fmt::print(stderr, "rangecal: {}\n", one_line(what)); }

int stdout_failed(const std::string& reason) {
  complain("stdout: cannot be written: " + reason);
  return app::not_delivered;
}

std::string version_text() {
  std::string text = fmt::format("rangecal {}\nbuilt with", version());
  for (const BuiltWith& part : built_with())
    text += fmt::format("{} {} {}", &part == &built_with().front() ? "" : ",", part.name, part.version);
  return text;
}

/// `code`, or that of standard output where it did not take all.
int flushed(int code) {
  if (std::fflush(stdout) != 0 || std::ferror(stdout)) return stdout_failed(std::strerror(errno));
  return code;
}

int run(int argc, char** argv) {
  CLI::App app{
      "Calibrates cheap range sensors from recordings of landmarks at unknown places, or of known distances.",
      "rangecal"};
  app.set_version_flag("--version", version_text());
  app.require_subcommand(1);
  app.footer(
      "Examples:\n"
      "  rangecal compare notebooks_data/field-layout           four methods side by side\n"
      "  rangecal calibrate my-recording --json cal.json        calibrate, keep the result\n"
      "  echo 1.234 | rangecal correct cal.json                 true distance behind a reading\n"
      "  rangecal diagnose my-recording                         what the model leaves out, and why\n"
      "  rangecal track stream.csv --json cal.json              calibrate as the readings come\n"
      "  rangecal simulate notebooks_data/scenes/field-layout.yaml -o sim --seed 7\n"
      "\n"
      "'rangecal COMMAND --help' explains a command. A recording is a folder with recording.yaml and CSV tables.\n"
      "Exit codes: 0 done; 1 the work ran but could not deliver what was asked; 2 bad input or usage.");
  app::Logging logging;
  logging.add_to(app);
  app.fallthrough();
  app::Action chosen;
  app::add_calibrate(app, chosen);
  app::add_compare(app, chosen);
  app::add_correct(app, chosen);
  app::add_simulate(app, chosen);
  app::add_diagnose(app, chosen);
  app::add_effects(app, chosen);
  app::add_export(app, chosen);
  app::add_extract(app, chosen);
  app::add_fleet(app, chosen);
  app::add_import(app, chosen);
  app::add_plan(app, chosen);
  app::add_predict(app, chosen);
  app::add_prove(app, chosen);
  app::add_study(app, chosen);
  app::add_track(app, chosen);
  const auto is_first = [&](CLI::App* command) { return argc > 1 && command->get_name() == argv[1]; };
  if (argc > 1 && argv[1][0] != '-' && app.get_subcommands(is_first).empty())
    throw InputError(fmt::format("'{}' is not a command; see 'rangecal --help'", argv[1]));
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help_or_version) {
    std::ostringstream text;
    const int code = app.exit(help_or_version, text, text);
    fmt::print("{}", text.str());
    return flushed(code);
  } catch (const CLI::ParseError& error) {
    std::string of;  // the command that the line named, and its own: "import lego "
    for (auto named = app.get_subcommands(); !named.empty(); named = named.front()->get_subcommands())
      of += named.front()->get_name() + " ";
    complain(fmt::format("{}; see 'rangecal {}--help'", one_line(error.what()), of));
    return app::bad_input;
  }
  logging.start(argv[0]);
  return flushed(chosen());
}

}  // namespace

int main(int argc, char** argv) {
  std::signal(SIGXFSZ, SIG_IGN);  // a file at its limit is a write that fails, as on a full disk
  try {
    return run(argc, argv);
  } catch (const rangecal::NoAnswerError& error) {
    complain(error.what());
    return app::not_delivered;
  } catch (const rangecal::InputError& error) {
    complain(error.what());
    return app::bad_input;
  } catch (const std::exception& error) {
    const auto* of_system = dynamic_cast<const std::system_error*>(&error);  // fmt's, where the disk is full
    if (of_system && std::ferror(stdout)) return stdout_failed(of_system->code().message());
    complain(std::string("internal error: ") + error.what());
    return app::not_delivered;
  }
}
