// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <cmath>

#include "diagnosis_words.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "report.hpp"
#include "residuals.hpp"
#include "text.hpp"

namespace rangecal::report {
namespace {

struct Badge {
  const char *word, *colour;
};
Badge badge_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::no_mismatch:
      return {"no mismatch", "good"};
    case Verdict::explained:
      return {"explained", "warn"};
    case Verdict::partly_explained:
      return {"explained in part", "warn"};
    case Verdict::unexplained:
      return {"unexplained", "bad"};
    case Verdict::unobservable:
      return {"not determined", "bad"};
  }
  return {"", ""};
}

void add_key_figures(Page& page, const Diagnosis& d) {
  std::vector<Page::Figure> figures;
  if (d.verdict == Verdict::explained && !d.explanations.empty())
    figures.push_back(
        {fmt::format("{:.2f}", d.explanations[0].probability),
         "probability of " + ids_in_words(d.explanations[0].effects, " + ") + " among the sets tried"});
  if (!d.final_effects.empty()) {
    if (d.before.heldout_nll && d.after.heldout_nll)
      figures.push_back(
          {fmt::format("{:.1f}{}", *d.before.heldout_nll - *d.after.heldout_nll,
                       d.after.heldout_std ? fmt::format(" +- {:.1f}", *d.after.heldout_std) : std::string()),
           "nats gained on readings held out"});
    figures.push_back({fmt::format("{:.2f} → {:.2f}", d.before.chi_sq_per_dof, d.after.chi_sq_per_dof),
                       "chi-square per degree of freedom"});
  } else {
    figures.push_back({fmt::format("{:.2f}", d.before.chi_sq_per_dof), "chi-square per degree of freedom"});
  }
  figures.push_back(
      {app::p_in_words(d.alarm_p_value), "that chance alone makes any question of the search look as bad"});
  page.figures(figures);
}

void add_explanation(Page& page, const Diagnosis& d) {
  if (d.explanations.empty()) return;
  page.section("The explanation");
  const Explanation& best = d.explanations[0];
  Table effects{{{"effect"}, {"physics"}, {"formula"}}, {}, true};
  for (const std::string& id : best.effects)
    if (const Effect* effect = find_effect(id))
      effects.rows.push_back({id_in_words(id), effect->info().physics, effect->info().formula});
  if (effects.rows.empty())
    page.paragraph(best.physics);
  else
    page.table(effects);
  const std::vector<app::MemberRow> members = app::member_rows(d);
  if (!members.empty()) {
    page.heading("What speaks for each name");
    Table names{{{"name"},
                 {"probability", true},
                 {"evidence lost without it [nats]", true},
                 {"held out, lost without it [nats]", true}},
                {},
                true};
    for (const app::MemberRow& row : members)
      names.rows.push_back({row.effect, row.probability, row.evidence, row.held_out});
    page.table(names);
  }
  page.heading("Parameters of the completed model");
  Table parameters{{{"parameter"}, {"value ± standard deviation", true}, {"unit"}}, {}, false};
  for (const app::ParameterRow& row : app::parameter_rows(d))
    parameters.rows.push_back({row.name, row.value, row.unit});
  page.table(parameters);
  if (d.explanations.size() > 1) {
    page.heading("With its rivals");
    Table rivals{{{"effects"}, {"probability", true}, {"NLL [nats]", true}, {"physics"}}, {}, true};
    for (const Explanation& e : d.explanations)
      rivals.rows.push_back({ids_in_words(e.effects, " + "), fmt::format("{:.3f}", e.probability),
                             fmt::format("{:.1f}", e.nll), e.physics});
    page.table(rivals);
  }
}

void add_before_after(Page& page, const Diagnosis& d) {
  const bool same = d.final_effects.empty();
  page.section(
      same ? "The fit in numbers" : "Before and after",
      same ? ""
           : "Held-out: whole blocks left out of the fit, predicted from the rest; lower NLL is better.");
  Table table{{{""}, {"seed model", true}}, {}, false};
  if (!same) table.columns.insert(table.columns.end(), {{"completed", true}, {"change"}});
  for (const app::BeforeAfter& row : app::before_after_rows(d)) {
    table.rows.push_back({row.name, row.before});
    if (!same) table.rows.back().insert(table.rows.back().end(), {row.after, row.note});
  }
  page.table(table);
  if (const std::string blocks = app::held_out_in_words(d); !blocks.empty()) page.paragraph(blocks + ".");
}

void add_open_questions(Page& page, const Diagnosis& d) {
  Table twins{{{"these"}, {"told apart by"}}, {}, true};
  if (!d.explanations.empty())
    for (const auto& set : d.explanations[0].indistinguishable_from)
      twins.rows.push_back(
          {app::rivals_in_words(d.explanations[0].effects, set), d.explanations[0].separated_by});
  for (const auto& set : d.twins) {
    std::string by;
    for (const std::string& id : set)  // in words for this recording where it has them
      for (const Unseen& u : d.unseen)
        if (u.effect == id && by.empty()) by = u.settled_by;
    for (const std::string& id : set)
      if (const Effect* effect = find_effect(id); effect && by.empty()) by = effect->info().settled_by;
    twins.rows.push_back({ids_in_words(set, " = "), by});
  }
  if (!twins.rows.empty()) {
    page.section("What cannot be told apart", "No reading of this recording separates the members of a row.");
    page.table(twins);
  }
  if (!d.unseen.empty()) {
    page.section("What could be hidden",
                 "Effects that could be there at their typical size without a trace, and what each would "
                 "cost in corrected range.");
    Table unseen{
        {{"effect"}, {"typical size"}, {"harm RMS [mm]", true}, {"would show", true}, {"settled by"}},
        {},
        true};
    for (const Unseen& u : d.unseen) {
      unseen.rows.push_back({id_in_words(u.effect), app::typical_in_words(u), app::millimetres(u.harm_m),
                             app::detectable_in_words(u), u.settled_by});
    }
    page.table(unseen);
  }
  if (!d.next_experiments.empty()) {
    page.section("What to record next",
                 "Power is computed for this recording extended by the change; harm is what the settled "
                 "effects could cost together with it left undone.");
    Table next{{{"change"}, {"settles"}, {"power", true}, {"largest harm settled [mm]", true}}, {}, true};
    for (const NextExperiment& e : d.next_experiments) {
      double range_error = 0.0;
      for (const Unseen& u : d.unseen)
        for (const std::string& id : e.settles)
          if (u.effect == id) range_error = std::max(range_error, u.harm_m);
      next.rows.push_back({e.change, ids_in_words(e.settles, ", "), fmt::format("{:.2f}", e.power),
                           range_error > 0.0 ? app::millimetres(range_error) : std::string("-")});
    }
    page.table(next);
  }
}

/// Scores of orders and noise laws of the seed model; none where it cannot be fitted.
std::vector<ModelScore> scores_of(std::span<const Recording> recordings) {
  CalibrateOptions options;
  options.methods = {Method::marginal};
  options.noise_shape = NoiseShape::gaussian;
  try {
    return calibrate_report(recordings, options).models;
  } catch (const InputError&) {
    return {};
  }
}

}  // namespace

std::string diagnosis_page(std::span<const Recording> recordings, const Diagnosis& d) {
  require_available();
  Page page("rangecal diagnosis", app::describe(recordings));
  const Badge badge = badge_of(d.verdict);
  page.verdict(badge.word, badge.colour, d.sentence);
  add_key_figures(page, d);

  std::vector<std::string> covariates = covariates_of(d);
  covariates.insert(covariates.end(), {"range", "sensor_bearing"});
  const std::vector<Recording> relabelled_recordings = relabelled(recordings, d.simulation);
  const FitView recorded = view_of({recordings.begin(), recordings.end()}, d.baseline);
  const FitView before = view_of(relabelled_recordings, d.baseline, covariates);
  const bool completed = !d.final_effects.empty();
  const FitView final_view =
      completed ? view_of(relabelled_recordings, d.simulation.calibration, covariates, d.simulation.added)
                : before;
  add_readings(page, final_view);
  add_scene(page, final_view);
  std::vector<NamedCurve> curves{{"seed model", "var(--before)", &d.baseline}};
  if (completed) curves.push_back({"completed model", "var(--after)", &final_view.calibration});
  add_curves(page, curves, scores_of(recordings));

  std::string lead = residuals_lead;
  if (!d.location.empty())
    lead +=
        " A p-value is the chance that any question of the whole search finds as much in a recording without a mismatch. Shares of "
        "the excess misfit overlap, for one cause shows along several covariates.";
  page.section(completed ? "Residuals before and after" : "Residuals", lead);
  if (add_findings(page, d, recorded, before, completed ? &final_view : nullptr, 3) == 0)
    add_plain_residuals(page, before);
  add_noise(page, final_view);
  add_explanation(page, d);
  add_before_after(page, d);
  add_open_questions(page, d);

  page.section("How the fit went");
  const Calibration& c = d.corrected;
  std::vector<std::string> items{
      "Readings: " + app::describe(d.baseline.counts) + ".",
      fmt::format("Curve of order {}, noise law {}, fitted from {:.2f} to {:.2f} m.", c.order(),
                  app::law_in_words(c.noise.law), c.range_min_m, c.range_max_m)};
  if (!c.weakest_direction.empty()) items.push_back("Weakest direction: " + c.weakest_direction + ".");
  items.insert(items.end(), d.notes.begin(), d.notes.end());
  page.list(items);
  return page.html();
}

}  // namespace rangecal::report
