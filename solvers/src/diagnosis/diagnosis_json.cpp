// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "rangecal/core/quantiles.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal {
namespace {

using Json = nlohmann::ordered_json;

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }
Json number(const std::optional<double>& value) { return value ? number(*value) : Json(nullptr); }
/// Never 0: the least stands for that or less.
Json p_value(double p) { return number(p < Finding::least_p_value ? Finding::least_p_value : p); }

Json estimate(double value, double std_dev, double low, double high) {
  return {{"estimate", number(value)},
          {"std", number(std_dev)},
          {"ci95", Json::array({number(low), number(high)})}};
}

Json estimate(double value, std::optional<double> std_dev) {
  if (!std_dev || !std::isfinite(*std_dev))
    return {{"estimate", number(value)}, {"std", nullptr}, {"ci95", nullptr}};
  return estimate(value, *std_dev, value - z95 * *std_dev, value + z95 * *std_dev);
}

/// The calibration's own parameters: alpha_i [m^(1-i)], the noise law's, and sigma_theta.
Json calibration_parameters(const Calibration& c) {
  Json parameters = Json::object();
  for (Eigen::Index i = 0; i < c.alpha.size(); ++i) {
    std::optional<double> std_dev;
    if (c.alpha_covariance) std_dev = std::sqrt(std::max(0.0, (*c.alpha_covariance)(i, i)));
    parameters[fmt::format("alpha_{}", i)] = estimate(c.alpha[i], std_dev);
  }
  for (std::size_t i = 0; i < c.noise_estimates.size(); ++i)
    parameters[c.noise_estimates.size() == 1 ? "sigma_e" : fmt::format("beta_{}", i)] =
        estimate(c.noise_estimates[i].value, c.noise_estimates[i].std_dev);
  if (c.sigma_theta_rad)
    parameters["sigma_theta_rad"] = estimate(c.sigma_theta_rad->value, c.sigma_theta_rad->std_dev);
  return parameters;
}

/// Ids as physics has them: the column of an effect along one stands elsewhere.
std::vector<std::string> plain(std::vector<std::string> ids) {
  for (std::string& id : ids) id = id_without_column(id);
  return ids;
}
std::vector<std::vector<std::string>> plain(std::vector<std::vector<std::string>> sets) {
  for (std::vector<std::string>& set : sets) set = plain(std::move(set));
  return sets;
}

/// "EFFECT.PARAMETER"; of two along different columns each with its column, "EFFECT:COLUMN.PARAMETER".
Json effect_parameters(const Explanation& explanation) {
  const std::vector<std::string> ids = plain(explanation.effects);
  Json parameters = Json::object();
  for (const EffectEstimate& e : explanation.parameters) {
    const std::size_t dot = e.name.rfind('.');
    const std::string id = id_without_column(e.name.substr(0, dot));
    const bool alone = std::count(ids.begin(), ids.end(), id) <= 1;
    const std::string name = alone ? id + e.name.substr(dot) : e.name;
    parameters[name] = estimate(e.estimate, e.std_dev, e.low95, e.high95);
    parameters[name]["note"] = e.note;
  }
  return parameters;
}

Json where(const Finding& f) {
  if (!f.group.empty()) {
    Json place = {{"group", f.group}};
    if (f.from) place["from"] = number(f.from);
    if (f.to) place["to"] = number(f.to);
    return place;
  }
  if (!f.from && !f.to) return nullptr;
  return {{"from", number(f.from)}, {"to", number(f.to)}};
}

Json finding(const Finding& f) {
  Json json = {{"channel", f.channel},
               {"covariate", f.covariate},
               {"shape", f.shape},
               {"effects", plain(f.effects)},
               {"where", where(f)},
               {"everywhere", f.everywhere.empty() ? Json(nullptr) : Json(f.everywhere)},
               {"size", number(f.size)},
               {"unit", f.unit},
               {"p_value", p_value(f.p_value)},
               {"log10_p", number(f.log_p / std::numbers::ln10)},
               {"share", number(f.share)}};
  Json bins = Json::array();
  for (const BinnedResidual& b : f.residuals)
    bins.push_back({{"at", number(b.at)},
                    {"before", number(b.before)},
                    {"after", number(b.after)},
                    {"std", number(b.std_dev)},
                    {"readings", b.readings}});
  json["residuals"] = bins;
  return json;
}

Json explanation(const Explanation& e) {
  return {{"effects", plain(e.effects)},          {"probability", number(e.probability)},
          {"parameters", effect_parameters(e)},   {"nll", number(e.nll)},
          {"heldout_nll", number(e.heldout_nll)}, {"heldout_std", number(e.heldout_std)},
          {"p_value", p_value(e.p_value)},        {"indistinguishable_from", plain(e.indistinguishable_from)},
          {"separated_by", e.separated_by},       {"physics", e.physics}};
}

/// What has no name.
Json rest(const Diagnosis& d) {
  Json rest = Json::array();
  for (const Finding& f : d.location)
    if (f.effects == std::vector<std::string>{"generic"})
      rest.push_back({{"channel", f.channel},
                      {"covariate", f.covariate},
                      {"size", number(f.size)},
                      {"unit", f.unit},
                      {"share", number(f.share)}});
  return rest;
}

Json members(const Diagnosis& d) {
  Json members = Json::array();
  for (const Member& m : d.members)
    members.push_back(
        {{"effect", id_without_column(m.effect)},
         {"column", column_in_id(m.effect).empty() ? Json(nullptr) : Json(column_in_id(m.effect))},
         {"probability", number(m.probability)},
         {"log_evidence_without", number(m.log_evidence_without)},
         {"heldout_nll_without", number(m.heldout_nll_without)}});
  return members;
}

Json law_json(const Law& law) {
  Json parameters = Json::object();
  for (const EffectEstimate& e : law.parameters)
    parameters[e.name] = {{"estimate", number(e.estimate)},
                          {"std", number(e.std_dev)},
                          {"ci95", {number(e.low95), number(e.high95)}},
                          {"note", e.note}};
  return {{"id", law.id},
          {"channel", law.channel},
          {"formula", law.formula},
          {"variables", plain(law.variables)},
          {"parameters", parameters},
          {"log_evidence", number(law.log_evidence)},
          {"log_evidence_over_curve", number(law.log_evidence_over_curve)},
          {"agrees_with_first", law.agrees_with_first}};
}

Json fit(const FitSummary& f) {
  return {{"rms_range_m", number(f.rms_range_m)},
          {"heldout_rms_range_m", number(f.heldout_rms_range_m)},
          {"rms_bearing_rad", number(f.rms_bearing_rad)},
          {"chi_sq_per_dof", number(f.chi_sq_per_dof)},
          {"heldout_std", number(f.heldout_std)}};
}

}  // namespace

std::string diagnosis_to_json(const Diagnosis& d) {
  Json json;
  json["format"] = "rangecal-diagnosis/1";
  json["verdict"] = to_string(d.verdict);
  json["sentence"] = d.sentence.empty() ? verdict_sentence(d) : d.sentence;
  json["alarm_p_value"] = p_value(d.alarm_p_value);
  json["baseline"] = {{"order", d.baseline.order()},
                      {"noise_law", to_string(d.baseline.noise.law)},
                      {"outcome", to_string(d.baseline.outcome)},
                      {"weakest_direction", d.baseline.weakest_direction},
                      {"nll", number(d.before.nll)},
                      {"heldout_nll", number(d.before.heldout_nll)},
                      {"parameters", calibration_parameters(d.baseline)},
                      {"fit", fit(d.before)}};
  json["location"] = Json::array();
  for (const Finding& f : d.location) json["location"].push_back(finding(f));
  json["explanations"] = Json::array();
  for (const Explanation& e : d.explanations) json["explanations"].push_back(explanation(e));
  Json parameters = calibration_parameters(d.corrected);
  if (!d.explanations.empty()) parameters.update(effect_parameters(d.explanations[0]));
  json["final"] = {{"effects", plain(d.final_effects)},
                   {"outcome", to_string(d.corrected.outcome)},
                   {"weakest_direction", d.corrected.weakest_direction},
                   {"nll", number(d.after.nll)},
                   {"heldout_nll", number(d.after.heldout_nll)},
                   {"parameters", parameters},
                   {"fit", fit(d.after)},
                   {"rest", rest(d)},
                   {"members", members(d)},
                   {"evidence_omitted", number(d.evidence_omitted)},
                   {"nearly_as_likely", plain(d.nearly_as_likely)}};
  json["twins"] = plain(d.twins);
  json["unseen"] = Json::array();
  for (const Unseen& u : d.unseen) {
    Json typical = Json::object();
    for (const auto& [name, value] : u.typical) typical[name] = number(value);
    json["unseen"].push_back({{"effect", id_without_column(u.effect)},
                              {"typical", typical},
                              {"detectable", number(u.detectable)},
                              {"harm_m", number(u.harm_m)},
                              {"settled_by", u.settled_by}});
  }
  json["next_experiments"] = Json::array();
  for (const NextExperiment& e : d.next_experiments)
    json["next_experiments"].push_back(
        {{"change", e.change}, {"settles", plain(e.settles)}, {"power", number(e.power)}});
  json["notes"] = d.notes;
  if (!d.laws.empty()) {
    json["laws"] = Json::array();
    for (const Law& law : d.laws) json["laws"].push_back(law_json(law));
  }
  if (!d.heldout_blocks.empty()) {
    json["heldout_blocks"] = d.heldout_blocks;
    json["heldout_effective_blocks"] = d.heldout_effective_blocks;
  }
  std::string text = json.dump(2);
  if (!d.simulation.recordings.empty()) {  // its long columns stay on one line each
    text.erase(text.rfind('\n'));
    text += ",\n  \"simulation\": " + simulation_model_to_json(d.simulation) + "\n}";
  }
  return text + "\n";
}

std::string trace_to_json(const std::vector<TriedSet>& sets) {
  Json written = Json::array();
  for (const TriedSet& set : sets) {
    Json proposals = Json::array();
    for (const TriedSet::Proposal& p : set.proposals)
      proposals.push_back({{"members", p.members},
                           {"promised", number(p.predicted_gain)},
                           {"log_posterior", number(p.log_posterior)},
                           {"fitted", p.fitted}});
    written.push_back({{"members", set.members},
                       {"parent", set.parent},
                       {"promised", number(set.predicted_gain)},
                       {"gain", number(set.gain)},
                       {"parameter_volume", number(set.parameter_volume)},
                       {"formula_allowance", number(set.formula_allowance)},
                       {"prior_mass", number(set.prior_mass)},
                       {"log_posterior", number(set.log_posterior)},
                       {"probability", number(set.probability)},
                       {"scanned", set.scanned},
                       {"proposals", std::move(proposals)}});
  }
  return Json{{"format", "rangecal-trace/1"}, {"sets", std::move(written)}}.dump(2) + "\n";
}

}  // namespace rangecal
