// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/laws/law_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "diagnosis/battery.hpp"
#include "diagnosis/candidates.hpp"
#include "diagnosis/effect_estimates.hpp"
#include "diagnosis/laws/pieces.hpp"
#include "diagnosis/select/evidence.hpp"
#include "diagnosis/select/priors.hpp"
#include "in_parallel.hpp"
#include "rangecal/problems/effects/formula_effect.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr std::size_t kept_at_a_time = 3;   ///< laws that are extended further
constexpr double within_reach = 15.0;       ///< nats below the likeliest down to which they are
constexpr std::size_t fitted_of_terms = 8;  ///< candidate terms of a law that are fitted
constexpr double fits_add = 0.3;          ///< share of the best predicted gain that a fit may add to another
constexpr std::size_t peaks_of_term = 2;  ///< starting points of each fit
constexpr double low_peak = 0.6;          ///< a start of less than this share of the best is none
constexpr std::size_t listed = 5;
constexpr int most_terms = 6;  ///< the evidence stops growing long before
constexpr double per_parameter =
    1.5;                        ///< nats that each parameter of a term costs in the ranking before the fit
constexpr double grows = 1.0;   ///< nats of evidence that a further term must add
constexpr double alike = 0.95;  ///< laws agree if one explains this part of the other's change, in squares

constexpr auto is_likelier = [](const auto& a, const auto& b) { return a.log_evidence > b.log_evidence; };

/// A law that the search may still extend.
struct Growing {
  std::vector<LawPiece> pieces;
  std::vector<std::shared_ptr<Effect>> effects;  ///< one a term, at the end of the fit's model
  Fit fit;
  double log_evidence = 0.0;
};

/// A term that a law may grow by, and its predicted gain beside a fit [nats].
struct CandidateTerm {
  std::size_t piece = 0;
  std::shared_ptr<Effect> effect;
  std::vector<Height> peaks;
  double worth = -std::numeric_limits<double>::infinity();
};

class LawSearch {
 public:
  LawSearch(const Rows& rows, const Fit& base, const std::string& channel, const Rates& rates,
            const RefitOptions& options)
      : rows_(rows), base_(base), channel_(channel), rates_(rates), options_(as_they_are(base, options)) {
    base_volume_ = log_calibration_volume(rows, base);
  }

  /// `to_beat`: evidence below which no law is of use.
  std::vector<Growing> run(double to_beat = -std::numeric_limits<double>::infinity()) const {
    std::vector<Growing> all, front{{{}, {}, base_, 0.0}};
    for (int number = 1; number <= most_terms && !front.empty(); ++number) {
      std::vector<Growing> next;
      for (const Growing& law : front)
        for (Growing& larger : grown(law, number))
          if (larger.log_evidence > law.log_evidence + grows) next.push_back(std::move(larger));
      std::stable_sort(next.begin(), next.end(), is_likelier);
      all.insert(all.end(), next.begin(), next.end());
      const double best = std::max(to_beat, next.empty() ? to_beat : next.front().log_evidence);
      std::erase_if(next, [&](const Growing& law) { return law.log_evidence < best - within_reach; });
      if (next.size() > kept_at_a_time) next.resize(kept_at_a_time);
      front = std::move(next);
    }
    std::stable_sort(all.begin(), all.end(), is_likelier);
    return all;
  }

  const std::string& channel() const { return channel_; }

  /// Evidence of a fit over the base, without the cost of choosing its terms.
  double log_evidence_of(const Fit& fit) const {
    return base_.nll - fit.nll + log_parameter_volume(rows_, fit, base_.model.size(), options_, priors_) +
           log_calibration_volume(rows_, fit) - base_volume_;
  }

 private:
  std::vector<Growing> grown(const Growing& law, int number) const {
    const std::vector<LawPiece> pieces = law_pieces(rows_, channel_, number);
    const double choice = std::log(static_cast<double>(std::max<std::size_t>(1, pieces.size())));
    std::vector<CandidateTerm> terms(pieces.size());
    const Battery battery = Battery::of_nothing(rows_, law.fit.model, law.fit.state, rates_);
    in_parallel(
        pieces.size(), [&](std::size_t i) { terms[i] = candidate_term(battery, pieces[i], number, i); },
        jobs_at_once(rows_.size()));
    std::stable_sort(terms.begin(), terms.end(),
                     [](const CandidateTerm& a, const CandidateTerm& b) { return a.worth > b.worth; });
    const double best = terms.empty() ? 0.0 : terms.front().worth;
    const double least = std::max(0.0, (1.0 - fits_add) * best - within_reach);
    std::erase_if(terms, [&](const CandidateTerm& t) { return !(t.worth > least); });
    if (terms.size() > fitted_of_terms) terms.resize(fitted_of_terms);
    std::vector<std::optional<Growing>> made(terms.size());
    in_parallel(
        terms.size(), [&](std::size_t i) { made[i] = fitted(law, pieces[terms[i].piece], terms[i], choice); },
        jobs_at_once(rows_.size()));
    std::vector<Growing> larger;
    for (std::optional<Growing>& one : made)
      if (one) larger.push_back(std::move(*one));
    return larger;
  }

  CandidateTerm candidate_term(const Battery& battery, const LawPiece& piece, int number,
                               std::size_t index) const {
    CandidateTerm term;
    term.piece = index;
    const std::string id = "law_" + std::to_string(number) + "_" + std::to_string(index);
    term.effect = effect_from_formula(law_text({piece}, id, channel_), id);
    term.peaks = peaks_of(battery, *term.effect, peaks_of_term);
    if (term.peaks.empty()) return term;
    std::erase_if(term.peaks, [low = low_peak * term.peaks.front().first](const Height& peak) {
      return peak.first < low;
    });
    term.worth = term.peaks.front().first - per_parameter * static_cast<double>(piece.parameters.size());
    return term;
  }

  std::optional<Growing> fitted(const Growing& law, const LawPiece& piece, const CandidateTerm& term,
                                double choice) const {
    std::optional<Growing> best;
    for (const Height& peak : term.peaks) {
      Model model = law.fit.model;
      model.push_back({term.effect.get(), peak.second});
      Fit fit = refit(rows_, model, law.fit.state, options_);
      if (!fit.ok || (best && fit.nll >= best->fit.nll)) continue;
      best = Growing{law.pieces, law.effects, std::move(fit), 0.0};
    }
    if (!best) return std::nullopt;
    best->pieces.push_back(piece);
    best->effects.push_back(term.effect);
    best->log_evidence = log_evidence_of(best->fit) - static_cast<double>(best->pieces.size()) * choice;
    if (!std::isfinite(best->log_evidence)) return std::nullopt;
    return best;
  }

  const Rows& rows_;
  const Fit& base_;
  const std::string channel_;
  const Rates& rates_;
  RefitOptions options_;
  SelectionPriors priors_;
  double base_volume_ = 0.0;
};

/// What a law's terms change in its channel, row by row, about the mean.
Eigen::VectorXd change_by(const Rows& rows, const Growing& law, const std::string& channel) {
  const auto own = static_cast<std::ptrdiff_t>(law.effects.size());
  const Model terms(law.fit.model.end() - own, law.fit.model.end());
  const RowChanges changes = row_changes(rows, cell_geometry(rows, law.fit.state), terms);
  Eigen::VectorXd change = channel == "range"         ? changes.range
                           : channel == "bearing"     ? changes.bearing
                           : channel == "range_noise" ? changes.range_log_variance
                                                      : changes.bearing_log_variance;
  change.array() -= change.mean();
  return change;
}

/// The law as it is written to a file; its text contains the values of the parameters.
Law law_of(const Rows& rows, const Growing& growing, const std::string& channel, std::size_t number) {
  Law law;
  law.channel = channel;
  law.log_evidence = growing.log_evidence;
  const std::size_t first = growing.fit.model.size() - growing.effects.size();
  std::vector<LawPiece> pieces = growing.pieces;
  std::set<std::string> variables;
  const std::vector<EffectEstimate> estimates = effect_estimates(rows, growing.fit);
  for (std::size_t k = 0; k < pieces.size(); ++k) {
    const ActiveEffect& active = growing.fit.model[first + k];
    variables.insert(pieces[k].variables.begin(), pieces[k].variables.end());
    law.formula += (k == 0 ? "" : " + ") + pieces[k].formula;
    for (std::size_t j = 0; j < pieces[k].parameters.size(); ++j) {
      LawParameter& parameter = pieces[k].parameters[j];
      parameter.value = active.parameters[static_cast<Eigen::Index>(j)];
      const std::string& full = active.effect->info().parameters[j].name;
      for (const EffectEstimate& e : estimates) {
        if (e.name != active.effect->info().id + "." + full) continue;
        law.parameters.push_back(e);
        law.parameters.back().name = full;
        if (std::isfinite(e.std_dev) && e.std_dev > 0.0) parameter.std_dev = e.std_dev;
      }
    }
  }
  law.variables.assign(variables.begin(), variables.end());
  law.id = "law_" + std::to_string(number);
  law.text = law_text(pieces, law.id, channel);
  return law;
}

/// What the terms of a law are, in words.
std::set<std::string> words_of(const Growing& law) {
  std::set<std::string> words;
  for (const LawPiece& piece : law.pieces) words.insert(piece.words);
  return words;
}

/// A law beside a model, and its evidence over the seed model [nats]: that of the model's names included.
struct Found {
  Growing law;
  std::string channel;
  double log_evidence = 0.0;
};

/// The channel of laws for what a finding is about: errors that the readings of a cell share may be a mean that no question of the battery
/// is about. Empty: there is none.
std::string channel_of_laws(const Question& finding) {
  if (finding.channel == "range_dependence") return "range";
  if (finding.channel == "bearing_dependence") return "bearing";
  for (const char* const channel : {"range", "bearing", "range_noise", "bearing_noise"})
    if (finding.channel == channel) return channel;
  return {};
}

/// That of the curve; without one those of the findings.
std::vector<std::string> channels_of_laws(const SearchResult& found, const GenericModel* curve) {
  if (curve) return {curve->effect->info().channel};
  std::vector<std::string> channels;
  for (const Question& finding : found.left.empty() ? found.shapes : found.left) {
    const std::string channel = channel_of_laws(finding);
    if (!channel.empty() && std::find(channels.begin(), channels.end(), channel) == channels.end())
      channels.push_back(channel);
  }
  return channels;
}

/// ln of the number of variables that laws of a channel may follow.
double log_choice_of_variable(const Rows& rows, const std::string& channel) {
  std::set<std::string> variables;
  for (const LawPiece& piece : law_pieces(rows, channel, 1))
    variables.insert(piece.variables.begin(), piece.variables.end());
  return std::log(static_cast<double>(std::max<std::size_t>(1, variables.size())));
}

/// Laws as they are reported, the likeliest first; what describes the mismatch without them has the evidence `of_rest`.
std::vector<Law> listed_laws(const Rows& rows, const std::vector<Found>& all, double of_rest) {
  std::vector<Law> list;
  std::vector<std::set<std::string>> listed_terms;
  Eigen::VectorXd best;
  for (const Found& one : all) {
    if (list.size() == listed) break;
    // A law that only adds terms to a likelier one is not listed again.
    const std::set<std::string> terms = words_of(one.law);
    if (std::any_of(listed_terms.begin(), listed_terms.end(), [&](const std::set<std::string>& likelier) {
          return std::includes(terms.begin(), terms.end(), likelier.begin(), likelier.end());
        }))
      continue;
    listed_terms.push_back(terms);
    Law law = law_of(rows, one.law, one.channel, list.size() + 1);
    const Eigen::VectorXd change = change_by(rows, one.law, one.channel);
    if (list.empty()) best = change;
    law.log_evidence_over_curve = one.log_evidence - of_rest;
    law.agrees_with_first = one.channel == all.front().channel &&
                            (change - best).squaredNorm() < (1.0 - alike) * best.squaredNorm();
    list.push_back(std::move(law));
  }
  return list;
}

}  // namespace

LawSearchResult find_laws(const Rows& rows, const SearchResult& found, const GenericModel* curve,
                          const DiagnoseOptions& options, const RefitOptions& refit_options) {
  const std::vector<std::string> channels = channels_of_laws(found, curve);
  if (channels.empty()) return {};
  const Fit root = fit_root(rows, found.known, found.baseline, refit_options);
  const auto searches_from = [&](const Fit& base) {
    std::vector<LawSearch> searches;
    for (const std::string& channel : channels)
      searches.emplace_back(rows, base, channel, found.rates, refit_options);
    return searches;
  };
  const std::vector<LawSearch> from_root = searches_from(root);
  double cost_of_names = 0.0, of_names = 0.0;
  if (found.named()) {
    const auto names = static_cast<double>(found.best.fit.model.size() - root.model.size());
    cost_of_names = names * std::log(count_members(rows, 1.0).names);
    of_names = from_root.front().log_evidence_of(found.best.fit) - cost_of_names;
  }
  std::vector<Found> all, alone;
  double to_beat = of_names;
  if (found.partly())
    for (const LawSearch& search : searches_from(found.best.fit))
      for (Growing& law : search.run()) {
        const double evidence = of_names + law.log_evidence;
        to_beat = std::max(to_beat, evidence);
        all.push_back({std::move(law), search.channel(), evidence});
      }
  for (const LawSearch& search : from_root)
    for (Growing& law : search.run(to_beat)) {
      const double evidence = law.log_evidence;
      if (!found.named() || evidence > to_beat + options.naming_gap_nats)
        alone.push_back({std::move(law), search.channel(), evidence});
    }
  const bool in_place_of_names = found.named() && !alone.empty();
  if (!alone.empty()) all = std::move(alone);
  std::stable_sort(all.begin(), all.end(), is_likelier);
  LawSearchResult result;
  if (in_place_of_names) result.over_names = all.front().log_evidence - to_beat;
  const double of_rest = curve ? from_root.front().log_evidence_of(curve->fit) - cost_of_names -
                                     log_choice_of_variable(rows, channels.front())
                               : of_names;
  result.laws = listed_laws(rows, all, of_rest);
  return result;
}

}  // namespace rangecal::diagnosis
