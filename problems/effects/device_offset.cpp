// SPDX-License-Identifier: BSD-3-Clause
// V4. Every device, or target, has an offset of its own.
//
//   delta r = o_l for device l, o of the first = 0     [m]
//
// The level of the first device is alpha_0; radios are some 10 cm apart before they are calibrated, lidars some mm. Acts on
// the reading, after the curve. Source: antenna delays of ultra-wideband devices: Decawave APS014, 2018; zero points of
// lidars.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

constexpr int most_devices = 13;

class DeviceOffset final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "device_offset",
        .number = "V4",
        .kind = EffectKind::mean,
        .channel = "range",
        .covariate = "landmark",
        .physics =
            "The devices, or targets, differ by an offset each: antenna delays, zero points, or the place from "
            "which their distances were taped.",
        .formula = "delta r = o_l [m] of device l, counted from the first one's",
        .source = "antenna delays of ultra-wideband devices: Decawave APS014, 2018; zero points of lidars",
        .visible_by = "read the same distances with every device, labelled in the column landmark",
        .settled_by = "exchange the devices, or read one distance with each of them",
        .sizes_alike = true,
        .parameters = offsets()};
    return value;
  }

  std::string missing(const EffectContext& context) const override {
    if (context.kind != RecordingKind::pairs)
      return "known distances: the places of landmarks take their offsets up";
    if (context.landmark_count > most_devices) return "few devices: at most " + std::to_string(most_devices);
    return lacks_landmarks(context, 2);
  }

  std::pair<double, double> bounds(const EffectContext& context, std::size_t parameter) const override {
    const bool there = static_cast<int>(parameter) + 1 < context.landmark_count;
    return there ? Effect::bounds(context, parameter) : std::pair(0.0, 0.0);
  }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.range = at.landmark >= 1 && at.landmark < most_devices ? p[at.landmark - 1] : 0.0};
  }

  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double* /*p*/,
                                             int parameter) const override {
    return ReadingChange<double>{.range = at.landmark == parameter + 1 ? 1.0 : 0.0};
  }

  bool changes_with_distance() const override { return false; }
  bool differs_between_repeats() const override { return false; }

  std::vector<std::pair<std::string, double>> reported(const EffectContext& context,
                                                       const double* p) const override {
    std::vector<std::pair<std::string, double>> values;
    for (int l = 1; l < std::min(context.landmark_count, most_devices); ++l)
      values.emplace_back("offset_" + context.landmark_labels[static_cast<std::size_t>(l)] + "_m", p[l - 1]);
    return values;
  }

 private:
  static std::vector<EffectParameter> offsets() {
    std::vector<EffectParameter> all;
    for (int l = 1; l < most_devices; ++l)
      all.push_back(
          {.name = "offset_" + std::to_string(l) + "_m", .typical = 0.01, .low = -10.0, .high = 10.0});
    return all;
  }
};

}  // namespace

std::unique_ptr<Effect> make_device_offset() { return std::make_unique<DeviceOffset>(); }

}  // namespace rangecal::effects
