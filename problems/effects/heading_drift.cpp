// SPDX-License-Identifier: BSD-3-Clause
// M3. The heading drifts without being commanded: the base turns where it stands, or a gyro creeps.
//
//   phi_k = phi_k,commanded + h t_k     [rad]
//     t_k time of the stop scaled to 0 .. 1 over the recording, h [rad per run]
//
// Exact twin of bearing_drift with h = -b1. Source: derived: a heading that turns evenly in time.
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class HeadingDrift final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "heading_drift",
        .number = "M3",
        .kind = EffectKind::mean,
        .channel = "bearing",
        .covariate = "time",
        .physics = "The heading drifts evenly in time although no turn was commanded.",
        .formula = "phi_k += h t_k [rad], t_k time of stop k scaled to 0 .. 1",
        .source = "derived: a heading that turns evenly in time",
        .visible_by = "drive the same stops again in reverse order",
        .settled_by =
            "only an outside heading reference tells it from bearing_drift; harmless for the range curve",
        .over_the_recording = true,
        .exact_twins = {"bearing_drift"},
        .parameters = {{.name = "angle_rad", .typical = 0.01745, .low = -3.2, .high = 3.2}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override {
    return either(lacks_stops(context, 2),
                  context.stop_time_s.empty() ? std::string("times: a column time_s") : lacks_times(context));
  }

  bool acts_on_stops() const override { return true; }

  void stops(const EffectContext& context, const double* p, std::vector<StopPrior>& stops) const override {
    if (context.stop_time_s.size() != stops.size() || !(context.duration_s > 0.0)) return;
    for (std::size_t k = 0; k < stops.size(); ++k)
      stops[k].commanded.heading_rad += p[0] * context.stop_time_s[k] / context.duration_s;
  }
};

}  // namespace

std::unique_ptr<Effect> make_heading_drift() { return std::make_unique<HeadingDrift>(); }

}  // namespace rangecal::effects
