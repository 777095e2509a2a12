// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>

#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/outlook.hpp"
#include "diagnosis/report.hpp"
#include "diagnosis/search.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal {

const char* to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::no_mismatch: return "no_mismatch";
    case Verdict::explained: return "explained";
    case Verdict::unexplained: return "unexplained";
  }
  return "unexplained";
}

Diagnosis diagnose(std::span<const Recording> recordings, const DiagnoseOptions& options) {
  using namespace diagnosis;
  std::vector<Recording> corrected(recordings.begin(), recordings.end());
  Bookkeeping known = correct_labels(corrected);
  const Rows rows = make_rows(corrected);
  const Bookkeeping gaps = find_grids_and_gaps(rows);
  known.model.insert(known.model.end(), gaps.model.begin(), gaps.model.end());
  known.findings.insert(known.findings.end(), gaps.findings.begin(), gaps.findings.end());
  known.notes.insert(known.notes.end(), gaps.notes.begin(), gaps.notes.end());
  SearchResult found = search(rows, known, options);
  if (std::any_of(known.model.begin(), known.model.end(),
                  [](const ActiveEffect& a) { return a.effect->info().kind == EffectKind::label; })) {
    const Rows raw = make_rows(recordings);  // the baseline is that of the labels as recorded
    const Fit before = refit(raw, {}, found.baseline.state, RefitOptions{});
    if (before.ok) found.baseline.nll = before.nll;
  }
  Diagnosis result = assemble_report(rows, recordings, found, options);
  if (options.held_out) add_held_out(rows, found, options, result);
  add_outlook(rows, found, options, result);
  return result;
}

}  // namespace rangecal
