// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "closed_form/range_model.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/closed_form/pairs_approximate.hpp"

namespace rangecal {
namespace {

std::vector<RangeSample> samples_of(const Recording& recording) {
  if (recording.kind != RecordingKind::pairs)
    throw InputError("a calibration of pairs needs a recording of kind pairs");
  std::vector<RangeSample> samples(recording.pairs.size());
  for (std::size_t k = 0; k < samples.size(); ++k) {
    samples[k].d = recording.pairs.true_m[k];
    samples[k].y = recording.pairs.reading_m[k];
  }
  return samples;
}

Calibration from_model(const Recording& recording, const std::vector<RangeSample>& samples,
                       RangeWeighting weighting, const ClosedFormOptions& options) {
  Calibration result;
  result.kind = RecordingKind::pairs;
  result.counts = recording.counts;
  const RangeModel model = fit_range_model(samples, weighting, {}, options.order, options);
  result.outcome = model.outcome;
  result.reason = model.reason;
  if (!is_usable(model.outcome)) return result;
  result.alpha = model.alpha;
  result.alpha_covariance = model.alpha_covariance;
  result.noise = model.noise;
  result.noise_estimates = model.noise_estimates;
  const auto [low, high] = std::minmax_element(recording.pairs.true_m.begin(), recording.pairs.true_m.end());
  result.range_min_m = *low;
  result.range_max_m = *high;
  return result;
}

}  // namespace

Calibration closed_form_pairs(const Recording& recording, const ClosedFormOptions& options) {
  Calibration result = from_model(recording, samples_of(recording), RangeWeighting::ordinary, options);
  result.method = Method::closed_form;
  return result;
}

Calibration approximate_pairs(const Recording& recording, const ClosedFormOptions& options) {
  const std::vector<RangeSample> samples = samples_of(recording);
  for (const RangeSample& s : samples) {
    if (!(s.d > 0.0)) throw InputError("approximate_pairs: a true distance is not positive");
  }
  Calibration result = from_model(recording, samples, RangeWeighting::d_squared, options);
  result.method = Method::approximate;
  if (!is_usable(result.outcome)) return result;
  const PairsApproximate fit =
      approximate_pairs_fit(recording.pairs.true_m, recording.pairs.reading_m, result.order());
  if (options.noise_law == NoiseLaw::d_squared || options.noise_law == NoiseLaw::f_squared) {
    const double variance =
        options.noise_law == NoiseLaw::d_squared ? fit.sigma_e_sq_printed : fit.sigma_e_sq_reweighted;
    if (variance >= 0.0) {
      const double dof = static_cast<double>(samples.size()) - static_cast<double>(result.alpha.size());
      // About the curve of weights d^-4: chi-square under the law d^2; under f^2 as the moments have it (residual_spread.hpp).
      Estimate& estimate = result.noise_estimates[0];
      const double relative = options.noise_law == NoiseLaw::d_squared   ? std::sqrt(0.5 / dof)
                              : estimate.std_dev && estimate.value > 0.0 ? *estimate.std_dev / estimate.value
                                                                         : std::sqrt(0.5 / dof);
      estimate = Estimate{std::sqrt(variance), std::sqrt(variance) * relative};
      result.noise.parameters(0) = estimate.value;
    }
  }
  if (options.noise_law == NoiseLaw::d_squared) result.alpha_covariance = fit.alpha_covariance;
  return result;
}

}  // namespace rangecal
