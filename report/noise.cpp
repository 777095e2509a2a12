// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "fit_view.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/solvers/calibrate/curve.hpp"
#include "text.hpp"

namespace rangecal::report {

void add_noise(Page& page, const FitView& view) {
  struct Bin {
    double at = 0.0, square = 0.0;
    int readings = 0;
  };
  std::vector<double> distances, sizes;
  for (const ReadingResidual& x : view.residuals.readings) {
    distances.push_back(x.distance_m);
    sizes.push_back(1e3 * std::abs(x.range_residual_m));
  }
  std::map<int, Bin> bins;
  const std::vector<int> bin = bins_of_equal_shares(distances);
  for (std::size_t i = 0; i < bin.size(); ++i) {
    Bin& b = bins[bin[i]];
    b.at += distances[i];
    b.square += sizes[i] * sizes[i];
    ++b.readings;
  }
  Json rows = Json::array(), law = Json::array();
  for (const auto& [index, b] : bins) {
    if (index < 0) continue;
    const double rms = std::sqrt(b.square / b.readings), half = z95 * rms / std::sqrt(2.0 * b.readings);
    rows.push_back({{"at", number(b.at / b.readings)},
                    {"rms", number(rms)},
                    {"low", number(std::max(0.0, rms - half))},
                    {"high", number(rms + half)},
                    {"readings", b.readings}});
  }
  double high = limits_of(sizes).high;
  for (const CurvePoint& p : curve_points(view.calibration, 61)) {
    law.push_back({{"d", number(p.distance_m)}, {"spread", number(1e3 * p.noise_m)}});
    high = std::max(high, 1e3 * p.noise_m);
  }
  page.dataset("noise_bins", rows);
  page.dataset("noise_law", law);
  page.section("Noise against distance");
  page.charts({{"noise",
                "noise",
                {{"high", high}},
                "How far a reading misses, by distance",
                fmt::format("Points: |residual| of each reading. Line: the law {} as fitted. Dots: RMS of "
                            "the residuals in bins of equal shares, "
                            "with 95 % bars. {}",
                            app::law_in_words(view.calibration.noise.law), shown_in_words(sizes.size())),
                "plot"}});
}

}  // namespace rangecal::report
