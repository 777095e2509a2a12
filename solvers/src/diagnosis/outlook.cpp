// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/outlook.hpp"

#include <algorithm>

#include "diagnosis/unseen.hpp"

namespace rangecal::diagnosis {

void add_outlook(const Rows& rows, const SearchResult& found, const DiagnoseOptions& options, Diagnosis& result) {
  const Fit& fit = found.verdict == Verdict::explained ? found.best.fit : found.baseline;
  Rows own = rows;
  const std::vector<double> d = cell_geometry(rows, fit.state).d;
  own.context.range_min_m = *std::min_element(d.begin(), d.end());
  own.context.range_max_m = *std::max_element(d.begin(), d.end());
  const Space space(own, fit.model, fit.state);
  const std::vector<TypicalEffect> effects = catalogue_of(space);
  result.twins = find_twins(space, effects);
  const double threshold = detection_threshold(options.alarm_rate, found.effective_questions);
  if (options.unseen) result.unseen = find_unseen(space, effects, threshold);
}

}  // namespace rangecal::diagnosis
