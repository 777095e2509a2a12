// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "commands.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/problems/effects/formula_effect.hpp"
#include "rangecal/solvers/diagnosis/predict_law.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

using Json = nlohmann::ordered_json;

std::string sentence(const LawPrediction& p, const Effect& law) {
  const std::string size = fmt::format("{:.3g} +- {:.2g} times what was found", p.size, p.size_std);
  switch (p.verdict) {
    case LawVerdict::confirmed:
      return "Confirmed: it acts in this recording, " + size + ".";
    case LawVerdict::another_size:
      return "Its shape is here in another size: " + size + ".";
    case LawVerdict::refuted:
      return "Refuted: it would show in this recording, and does not: " + size + ".";
    case LawVerdict::not_tested:
      break;
  }
  std::string text = p.reason.empty()
                         ? "Not tested by this recording, which cannot tell it from nothing: " + size + "."
                         : "Not tested: " + p.reason + ".";
  std::string test = p.would_test.empty() ? law.info().visible_by : p.would_test;
  if (p.times_the_readings)
    test += fmt::format("{}{:.{}f} times as many readings like these", test.empty() ? "" : ", or ",
                        *p.times_the_readings, *p.times_the_readings < 10.0 ? 1 : 0);
  if (!test.empty()) text += " It would show with " + test + ".";
  if (p.reason.empty() && p.would_test.empty() && !p.times_the_readings)
    text += fmt::format(
        " Where it was found its own size is known to +- {:.2g} only: more readings there would help too.",
        p.found_std);
  return text;
}

std::string gain_in_words(const char* than, const std::optional<double>& gain,
                          const std::optional<double>& std_dev) {
  if (!gain) return {};
  return fmt::format("  {} than {} by {:.1f}{} nats on blocks left out\n", *gain >= 0.0 ? "better" : "worse",
                     than, std::abs(*gain), std_dev ? fmt::format(" +- {:.1f}", *std_dev) : "");
}

Json number(const std::optional<double>& value) {
  return value && std::isfinite(*value) ? Json(*value) : Json(nullptr);
}

struct PredictCommand {
  std::string law, json;
  std::vector<std::string> recordings;

  int run() const {
    require_writable({json});
    std::vector<std::string> inputs = recording_files(recordings);
    inputs.push_back(law);
    require_apart({json}, inputs);
    const std::unique_ptr<Effect> effect = effect_from_file(law);
    const EffectInfo& info = effect->info();
    if (info.kind != EffectKind::mean && info.kind != EffectKind::noise)
      throw InputError(law, 0, "",
                       "changes neither the mean nor the variance of readings: it cannot be predicted");
    const StatedValues values = stated_values(*effect);
    if (values.value.size() == 0)
      throw InputError(
          law, 0, "",
          "its parameters have no 'value': a law is a file that 'diagnose --laws' wrote, or one whose "
          "parameters have values");
    const LawPrediction p = predict_law(*effect, values, load_recordings(recordings));
    if (!json.empty()) write_file(json, as_json(info, p).dump(2) + "\n");
    fmt::print("{}: {} + {}\n\n{}\n", info.id, info.channel, info.formula, wrapped(sentence(p, *effect), 2));
    const std::string gains =
        gain_in_words("the seed model", p.heldout_gain, p.heldout_gain_std) +
        gain_in_words("a smooth curve fitted here", p.heldout_gain_over_curve, p.heldout_gain_over_curve_std);
    if (!gains.empty()) fmt::print("\nIts predictions, the calibration alone fitted, are\n{}", gains);
    return done;
  }

 private:
  static Json as_json(const EffectInfo& info, const LawPrediction& p) {
    return {{"format", "rangecal-prediction/1"},
            {"law", info.id},
            {"channel", info.channel},
            {"formula", info.formula},
            {"verdict", to_string(p.verdict)},
            {"size", number(p.size)},
            {"size_std", number(p.size_std)},
            {"would_test", p.would_test},
            {"times_the_readings", number(p.times_the_readings)},
            {"found_std", number(p.found_std)},
            {"heldout_gain", number(p.heldout_gain)},
            {"heldout_gain_std", number(p.heldout_gain_std)},
            {"heldout_gain_over_curve", number(p.heldout_gain_over_curve)},
            {"heldout_gain_over_curve_std", number(p.heldout_gain_over_curve_std)},
            {"reason", p.reason}};
  }
};

}  // namespace

void add_predict(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand("predict", "hold a law that was found against another recording");
  const auto state = std::make_shared<PredictCommand>();
  command
      ->add_option("LAW", state->law, "what 'diagnose --laws' wrote: a formula with its parameters' values")
      ->required();
  command->add_option("REC", state->recordings, "other recordings of the same sensor")->required();
  command->add_option("--json", state->json, "write the answer to this file (rangecal-prediction/1)");
  command->footer(
      "The law's parameters stay as they were found; nothing but the calibration is fitted. The answer is one of confirmed,\n"
      "another size, refuted, and not tested, where these readings would be alike with it and without it.\n"
      "\n"
      "Example:\n"
      "  rangecal diagnose monday --laws laws && rangecal predict laws/law_1.yaml tuesday\n"
      "docs/laws.md goes the whole way.");
  command->callback([state, &chosen] { chosen = [state] { return state->run(); }; });
}

}  // namespace rangecal::app
