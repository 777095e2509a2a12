// SPDX-License-Identifier: BSD-3-Clause
// W2. Two labels are exchanged at some stops.
//
//   readings of landmarks first and second, stops from .. to:  labels exchanged
//
// Changes no reading by itself: the search exchanges the labels and compares. Grid: all pairs, each stop
// alone and all stops from one on. Source: by definition: two labels exchanged from one stop to another.
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class LabelSwap final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "label_swap",
        .number = "W2",
        .kind = EffectKind::label,
        .channel = "label",
        .covariate = "landmark",
        .physics =
            "The labels of two landmarks are exchanged at some stops: look at the data association there.",
        .formula = "labels of landmarks first and second exchanged at stops from .. to",
        .source = "by definition: two labels exchanged from one stop to another",
        .visible_by = "any design: the residuals of the pair fall at once when swapped back",
        .settled_by = "correct the labels and extract the recording again",
        .parameters = {
            {.name = "first", .typical = 1.0, .low = 0.0, .high = 1e6, .linear = false, .discrete = true},
            {.name = "second", .typical = 1.0, .low = 0.0, .high = 1e6, .linear = false, .discrete = true},
            {.name = "from_stop", .typical = 1.0, .low = 0.0, .high = 1e6, .linear = false, .discrete = true},
            {.name = "to_stop", .typical = 1.0, .low = 0.0, .high = 1e6, .linear = false, .discrete = true}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    std::vector<Eigen::VectorXd> grid;
    const int last = context.stop_count - 1;
    for (int a = 0; a < context.landmark_count; ++a)
      for (int b = a + 1; b < context.landmark_count; ++b) {
        for (int k = 0; k <= last; ++k) grid.push_back(span(a, b, k, k));
        for (int k = 1; k < last; ++k) grid.push_back(span(a, b, k, last));
      }
    return grid;
  }

  std::string missing(const EffectContext& context) const override {
    return either(lacks_stops(context, 2), lacks_landmarks(context, 2));
  }

 private:
  static Eigen::VectorXd span(int first, int second, int from, int to) {
    return point({static_cast<double>(first), static_cast<double>(second), static_cast<double>(from),
                  static_cast<double>(to)});
  }
};

}  // namespace

std::unique_ptr<Effect> make_label_swap() { return std::make_unique<LabelSwap>(); }

}  // namespace rangecal::effects
