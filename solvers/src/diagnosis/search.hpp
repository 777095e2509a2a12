// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/candidates.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::diagnosis {

/// What the search found.
struct SearchResult {
  Fit baseline;
  Rates rates;
  double alarm_p = 1.0;  ///< corrected, of the baseline's battery
  Verdict verdict = Verdict::no_mismatch;
  Candidate best;                 ///< the explanation, for `explained`
  std::vector<Candidate> rivals;  ///< single-step alternatives the data do not reject, best first
  std::vector<Question> shapes;   ///< baseline's findings, best first, one per (channel, covariate)
  /// For `unexplained`: `best` (with its rivals) accounts for all of its own channel, and something nameless is
  /// left in the other.
  bool partial = false;
  std::vector<Question> left;            ///< findings of `last` then, as `shapes` are the baseline's
  std::unique_ptr<Battery> first, last;  ///< batteries of the baseline and of the final model
  std::vector<Candidate> tried;
  Bookkeeping known;
  std::vector<std::shared_ptr<Effect>> curves;  ///< without a name, of models in `tried`
};

/// The seed model fitted, its residuals scanned, and how likely they are without any cause.
SearchResult scan_seed_model(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options,
                             RefitOptions& refit_options);

/// The root of a search: the seed model with what bookkeeping found; the seed model alone where that cannot be fitted.
Fit fit_root(const Rows& rows, const Bookkeeping& known, const Fit& baseline, const RefitOptions& options);

/// Baseline, scan, explanation by refits, greedy extension. `known`: what bookkeeping found; it is part of
/// every model.
SearchResult search(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options);

/// Fits the seed model by marginal ML: order 2 (less where the distances do not carry it), the noise law of
/// highest marginal likelihood with the triangulation law preferred within 3 nats.
Fit fit_baseline(const Rows& rows, const DiagnoseOptions& options, RefitOptions& refit_options,
                 const Model& grids = {});

}  // namespace rangecal::diagnosis
