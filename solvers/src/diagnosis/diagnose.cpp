// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>

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
  const Rows rows = make_rows(recordings);
  SearchResult found = search(rows, options);
  Diagnosis result = assemble_report(rows, recordings, found, options);
  if (options.held_out) add_held_out(rows, found, options, result);
  add_outlook(rows, found, options, result);
  return result;
}

}  // namespace rangecal
