// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/candidates.hpp"
#include "diagnosis/grids.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::diagnosis {

/// What the search found.
struct SearchResult {
  Fit baseline;
  Rates rates;
  double alarm_p = 1.0;  ///< corrected, of the baseline's battery
  Verdict verdict = Verdict::no_mismatch;
  Candidate best;                 ///< what is named
  std::vector<Candidate> rivals;  ///< other sets that the data do not reject, best first
  std::vector<Question> shapes;   ///< baseline's findings, best first, one per (channel, covariate)
  std::vector<Question> left;  ///< of `partly_explained`: findings of `last`, as `shapes` are the baseline's
  std::unique_ptr<Battery> first, last;  ///< batteries of the baseline and of the final model
  Bookkeeping known;
  std::vector<Member> members;  ///< what speaks for each name of `best` that was searched for
  std::optional<double> evidence_omitted;
  std::vector<std::string> nearly_as_likely;  ///< ids; see Diagnosis

  bool partly() const { return verdict == Verdict::partly_explained; }
  /// True if `best` names something.
  bool named() const { return verdict == Verdict::explained || partly(); }
};

/// The seed model fitted, its residuals scanned, and how likely they are without any cause.
/// `law`: that of its noise, where it is not to be chosen.
SearchResult scan_seed_model(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options,
                             RefitOptions& refit_options, std::optional<NoiseLaw> law = std::nullopt);

/// The root of a search: the seed model with what bookkeeping found; the seed model alone where that cannot be fitted.
Fit fit_root(const Rows& rows, const Bookkeeping& known, const Fit& baseline, const RefitOptions& options);

/// Fits the seed model by marginal ML: order 2 (less where the distances do not carry it), the noise law of
/// highest likelihood with the triangulation law preferred within `law_margin`, or `law`.
Fit fit_baseline(const Rows& rows, const DiagnoseOptions& options, RefitOptions& refit_options,
                 const Model& grids = {}, std::optional<NoiseLaw> law = std::nullopt);

/// The model less what describes how the noise grows with distance: beside that, any law would make the readings.
Model without_law(Model model);

/// The law of the noise that is due beside the effects of a fit, by the same rule; none where that is the fit's own, or given by
/// a simulation.
std::optional<NoiseLaw> law_beside(const Rows& rows, const Fit& fit, const DiagnoseOptions& options,
                                   const RefitOptions& refit_options);

}  // namespace rangecal::diagnosis
