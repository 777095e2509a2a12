// SPDX-License-Identifier: BSD-3-Clause
// R1. The range zero is wrong by the same amount everywhere.
//
//   delta r = z     [m], z the range zero
//
// Acts on the reading, after the curve: alpha_0 takes it up exactly. A radius wrong by delta R on every
// landmark looks the same to first order, z = -f'(d) delta R. Source: derived: f(d) plus a constant.
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects {
namespace {

class RangeOffset final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "range_offset",
        .number = "R1",
        .kind = EffectKind::mean,
        .channel = "range",
        .covariate = "constant",
        .physics =
            "All ranges are off by one constant: the sensor's range zero, or the radius of every landmark, "
            "is wrong.",
        .formula =
            "delta r = z [m], z the range zero; a radius wrong by delta R everywhere gives z = -alpha_1 "
            "delta R",
        .expression = "offset",
        .source = "derived: f(d) plus a constant",
        .visible_by = "nothing in the recording itself: alpha_0 takes it up exactly, in every design",
        .settled_by = "measure the landmarks with a calliper, or read a flat board at a taped distance",
        .settled_of_pairs =
            {.otherwise =
                 "measure the known distances anew, from the sensor's zero to the target's face: alpha_0 takes an offset up in every design"},
        .parameters = {{.name = "offset_m", .typical = 0.005, .low = -10.0, .high = 10.0}}};
    return value;
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>&, const double* p) const override {
    return {.range = p[0]};
  }
};

}  // namespace

std::unique_ptr<Effect> make_range_offset() { return std::make_unique<RangeOffset>(); }

}  // namespace rangecal::effects
