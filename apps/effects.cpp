// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <cstdlib>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "commands.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/problems/effects/formula_effect.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

/// Where a parameter that no fit moves comes from.
const char* where_from(const Effect& effect) {
  return effect.noise_before_reciprocal() ? "that of the fitted noise" : "chosen from the recording";
}

std::string typical_sizes(const Effect& effect) {
  std::string text;
  for (const EffectParameter& p : effect.info().parameters)
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", p.name,
                        p.discrete ? where_from(effect) : fmt::format("{:g}", p.typical));
  return text;
}

/// What the parameter is measured in, by its name's ending; empty for a number.
std::string unit_of_parameter(const std::string& name) {
  const std::string unit = parameter_name(name).unit;
  return unit == "1" ? "" : unit;
}

std::string where_it_shows(const EffectInfo& info) {
  const bool nowhere_in_particular = info.covariate == "any" || info.covariate == "constant";
  return nowhere_in_particular ? info.channel : info.channel + " along " + info.covariate;
}

std::string markdown_section(const Effect& effect) {
  const EffectInfo& info = effect.info();
  const std::string number = info.number.empty() ? "" : info.number + ". ";
  std::string text = fmt::format("\n## {}\n\n{}\n\n    {}\n\n", info.id,
                                 wrapped(number + info.physics, 0, 120), wrapped(info.formula, 4, 120));
  text += "| parameter | unit | typical | from | to |\n|---|---|---|---|---|\n";
  for (const EffectParameter& p : info.parameters)
    text += fmt::format("| `{}` | {} | {} |\n", p.name, unit_of_parameter(p.name),
                        p.discrete ? fmt::format("{} | |", where_from(effect))
                                   : fmt::format("{:g} | {:g} | {:g}", p.typical, p.low, p.high));
  text += "\n";
  for (const auto& [title, words] : {std::pair{"shows in", where_it_shows(info)},
                                     {"visible by", info.visible_by},
                                     {"settled by", info.settled_by},
                                     {"twins in every design", ids_in_words(info.exact_twins, ", ")},
                                     {"source", info.source}})
    if (!words.empty()) text += fmt::format("- {}\n", wrapped(fmt::format("{}: {}", title, words), 2, 120));
  return text;
}

/// docs/effects.md.
int print_markdown() {
  fmt::print(
      "# The catalogue of effects\n\n"
      "What `rangecal diagnose` knows by name. The numbers are those by which the code cites the catalogue. Symbols: d\n"
      "distance to a landmark's surface [m], b direction in the sensor frame [rad], f the calibration's curve, R radius of a\n"
      "landmark [m]; an effect acts on d, before the curve, or on the reading, after it, as its formula says. Typical is a size\n"
      "often met, and the scale of the parameter's prior; from and to are bounds set by physics. `docs/gallery.md` has a\n"
      "picture of what each leaves behind. Printed by `rangecal effects --markdown`.\n\n"
      "| number | effect | shows in |\n|---|---|---|\n");
  std::map<std::pair<char, int>, std::string> rows;  // by letter, then by number
  for (const auto& effect : effect_registry()) {
    const EffectInfo& info = effect->info();
    const std::string& number = info.number;
    rows[number.empty() ? std::pair{'~', 0} : std::pair{number[0], std::atoi(number.c_str() + 1)}] +=
        fmt::format("| {} | [{}](#{}) | {} |\n", number, info.id, info.id, where_it_shows(info));
  }
  for (const auto& row : rows) fmt::print("{}", row.second);
  for (const auto& effect : effect_registry()) fmt::print("{}", markdown_section(*effect));
  return done;
}

int list_effects(const std::string& id) {
  if (!id.empty()) {
    const Effect* effect = find_effect(id);
    if (!effect) throw InputError("no effect is called '" + id + "'; 'rangecal effects' lists them");
    const EffectInfo& info = effect->info();
    const auto field = [](const char* name, const std::string& text) {
      if (!text.empty()) fmt::print("  {:<10} {}\n", name, wrapped(text, 13, 96));
    };
    fmt::print("{}\n", info.id);
    field("physics", info.physics);
    field("formula", info.formula);
    field("shows in", where_it_shows(info));
    field("visible by", info.visible_by);
    field("settled by", info.settled_by);
    field("twins", ids_in_words(info.exact_twins, ", "));  // in every design
    for (const EffectParameter& p : info.parameters)
      field("parameter", p.discrete ? fmt::format("{}: {}", p.name, where_from(*effect))
                                    : fmt::format("{}: typically {:g}, from {:g} to {:g}", p.name, p.typical,
                                                  p.low, p.high));
    field("source", info.source);
    if (!info.number.empty()) field("number", info.number + " of the catalogue (docs/effects.md)");
    return done;
  }
  for (const Effect* effect : known_effects()) {
    const EffectInfo& info = effect->info();
    fmt::print("{}  ({})\n    {}\n    {}\n    typical: {}\n", info.id, where_it_shows(info),
               wrapped(info.physics, 4, 96), wrapped(info.formula, 4, 96),
               wrapped(typical_sizes(*effect), 4, 96));
  }
  return done;
}

/// The effect as a file that --effects reads.
int print_formula(const std::string& id) {
  const Effect* effect = find_effect(id);
  if (!effect) throw InputError("no effect is called '" + id + "'; 'rangecal effects' lists them");
  const std::string text = as_formula(*effect);
  if (!text.empty()) {
    fmt::print("{}", text);
    return done;
  }
  std::string others;
  for (const Effect* other : known_effects())
    if (!as_formula(*other).empty()) others += (others.empty() ? "" : ", ") + other->info().id;
  throw InputError(
      id +
      " is no formula of one reading: it changes stops, several channels, how readings hang together, "
      "or something that is chosen from the recording. Those that are: " +
      others);
}

}  // namespace

void add_effects_option(CLI::App& command, std::vector<std::string>* folders) {
  command
      .add_option(
          "--effects",
          "folder of effects of your own, a formula in a .yaml file each (docs/effects-by-formula.md); they are "
          "treated as those of the catalogue")
      ->each([folders](const std::string& folder) {
        add_effects_by_formula(folder);
        if (folders) folders->push_back(folder);
      });
}

void add_effects(CLI::App& app, Action& chosen) {
  CLI::App* command =
      app.add_subcommand("effects", "list the catalogue of physical effects that diagnose knows");
  const auto id = std::make_shared<std::string>();
  const auto markdown = std::make_shared<bool>(false);
  CLI::Option* one = command->add_option("ID", *id, "show this effect alone, in full");
  const auto yaml = std::make_shared<bool>(false);
  add_effects_option(*command);
  command->add_flag("--as-yaml", *yaml, "print the effect ID as a file to copy and change, for --effects")
      ->needs(one);
  command->add_flag("--markdown", *markdown, "print docs/effects.md: all of them, in full")->excludes(one);
  command->footer(
      "Examples:\n"
      "  rangecal effects                       all of them, with formula and typical size\n"
      "  rangecal effects bearing_offset        what shows it, what settles it, its parameters and source\n"
      "  rangecal effects cyclic_error --as-yaml > my_effects/ripple.yaml    a start for an effect of your own\n"
      "docs/effects.md has all of them in full, docs/gallery.md a picture of what each leaves behind.");
  command->callback([id, markdown, yaml, &chosen] {
    chosen = [id, markdown, yaml] {
      if (*yaml) return print_formula(*id);
      return *markdown ? print_markdown() : list_effects(*id);
    };
  });
}

}  // namespace rangecal::app
