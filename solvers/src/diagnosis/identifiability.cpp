// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/identifiability.hpp"

#include <algorithm>

#include "diagnosis/next_experiments.hpp"
#include "diagnosis/unseen.hpp"

namespace rangecal::diagnosis {

void add_identifiability(const Rows& rows, const SearchResult& found, const DiagnoseOptions& options,
                         Diagnosis& result) {
  const Fit& fit = found.named() ? found.best.fit : found.baseline;
  Rows own = rows;
  const std::vector<double> d = cell_geometry(rows, fit.state).d;
  own.context.range_min_m = *std::min_element(d.begin(), d.end());
  own.context.range_max_m = *std::max_element(d.begin(), d.end());
  const Space space(own, fit.model, fit.state);
  const std::vector<TypicalEffect> effects = catalogue_of(space);
  // Twins are a matter of the design: they are asked of the seed model, whatever was named.
  const Space seed(own, {}, fit.state);
  result.twins = find_twins(seed, catalogue_of(seed));
  if (options.unseen) result.unseen = find_unseen(space, effects, options.alarm_rate, found.rates);
  if (options.next_experiments) add_next_experiments(space, found, options, fit.state, effects, result);
}

}  // namespace rangecal::diagnosis
