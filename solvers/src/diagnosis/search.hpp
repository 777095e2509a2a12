// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "diagnosis/battery.hpp"
#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/refit.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::diagnosis {

/// A catalogued model, fitted exactly.
struct Candidate {
  Fit fit;
  double promised = 0.0;  ///< gain in nats that its projected score promised
  double gain = 0.0;      ///< baseline NLL minus its NLL
  double evidence = 0.0;  ///< gain less one nat per parameter chosen (AIC): what models are ranked by
  double log_p = 0.0;     ///< of its question in the battery that proposed it
  int parameters = 0;
};

/// What the search found.
struct SearchResult {
  Fit baseline;
  double effective_questions = 1.0;
  double alarm_p = 1.0;  ///< corrected, of the baseline's battery
  Verdict verdict = Verdict::no_mismatch;
  Candidate best;                        ///< the explanation, for `explained`
  std::vector<Candidate> rivals;         ///< single-step alternatives the data do not reject, best first
  std::vector<Question> shapes;          ///< baseline's findings, best first, one per (channel, covariate)
  std::unique_ptr<Battery> first, last;  ///< batteries of the baseline and of the final model
  std::vector<Candidate> tried;
  Bookkeeping known;
};

/// Baseline, scan, explanation by refits, greedy extension. `known`: what bookkeeping found; it is part of
/// every model.
SearchResult search(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options);

/// Fits the seed model by marginal ML: order 2 (less where the distances do not carry it), the noise law of
/// highest marginal likelihood with the triangulation law preferred within 3 nats.
Fit fit_baseline(const Rows& rows, const DiagnoseOptions& options, RefitOptions& refit_options);

/// Noncentrality left between two effects: what `cause` does to the readings at its fitted size, after the
/// calibration and every direction of `rival` at its fit were projected out. Small: this design cannot tell
/// them apart, whatever the noise. Negative if either does not act on the mean.
double separation(const Rows& rows, const JointState& state, const ActiveEffect& cause,
                  const ActiveEffect& rival);

}  // namespace rangecal::diagnosis
