// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/calibration_io.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "rangecal/core/errors.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal {
namespace {

using test::TemporaryFolder;
using ::testing::HasSubstr;
using ::testing::StartsWith;

Calibration full_calibration() {
  Calibration c;
  c.method = Method::full;
  c.outcome = Outcome::converged;
  c.reason = "a reason with \"quotes\"";
  c.alpha = Eigen::Vector3d(0.0525, 0.8838, 1.0 / 3.0);
  c.alpha_covariance = (Eigen::Matrix3d() << 1, 0.1, 0, 0.1, 2, 0, 0, 0, 1e-17).finished();
  c.covariance_with_choice = Eigen::Matrix4d(Eigen::Vector4d(1, 2, 3, 4).asDiagonal());
  c.bound_alpha_std = Eigen::Vector3d(0.1, 1.0 / 7.0, 1e-9);
  c.covariance_reason = "optimistic";
  c.noise = {NoiseLaw::polynomial, Eigen::Vector2d(0.01, 0.002)};
  c.noise_estimates = {{0.01, 0.001}, {0.002, std::nullopt}};
  c.noise_shapes["range"] = {
      "contaminated", {{"outlier_share", 0.08}, {"outlier_scale", 12.0}}, {{"outlier_share", 0.02}}};
  c.sigma_theta_rad = Estimate{0.0087, 0.0003};
  c.sigma_s_m = Estimate{0.0, std::nullopt};
  c.sigma_s_upper95_m = 0.004;
  c.range_min_m = 0.33;
  c.range_max_m = 4.8;
  c.effects["range_eccentricity"]["amplitude_m"] = 0.0075;
  c.effects_covariance = {{"range_eccentricity.amplitude_m"},
                          Eigen::MatrixXd(Eigen::Vector4d(1.0, 2.0, 3.0, 1e-8).asDiagonal())};
  c.effects_covariance->matrix(1, 3) = c.effects_covariance->matrix(3, 1) = -1e-5 / 3.0;
  c.effects_range = {{"bearing_rad", {3.0, -1.0 / 3.0}}, {"temperature_c", {-5.0, 31.25}}};
  c.landmarks = {{0, "A", {1.5, -2.5}, Eigen::Matrix2d(Eigen::Matrix2d::Identity() * 1e-4)},
                 {1, "B", {0.1, 0.2}, std::nullopt}};
  c.stops = {{0, "7", {0.1, 0.2, -3.0}}};
  c.counts.read = 10;
  c.counts.used = 7;
  c.counts.dropped = {{"zero", 1}, {"missing", 2}};
  c.counts.cells_left_out = 1;
  c.joint_nll = -123.456;
  c.marginal_nll = -100.0;
  c.aic = -188.0;
  c.weakest_direction = "alpha_0 against alpha_1";
  c.iterations = 12;
  c.seconds = 0.25;
  return c;
}

void expect_same(const std::optional<Estimate>& a, const std::optional<Estimate>& b) {
  ASSERT_EQ(a.has_value(), b.has_value());
  if (!a) return;
  EXPECT_EQ(a->value, b->value);
  EXPECT_EQ(a->std_dev, b->std_dev);
}

void expect_same(const Calibration& a, const Calibration& b) {
  EXPECT_EQ(a.method, b.method);
  EXPECT_EQ(a.kind, b.kind);
  ASSERT_EQ(a.noise_shapes.size(), b.noise_shapes.size());
  for (const auto& [channel, shape] : a.noise_shapes) {
    EXPECT_EQ(shape.family, b.noise_shapes.at(channel).family);
    EXPECT_EQ(shape.parameters, b.noise_shapes.at(channel).parameters);
    EXPECT_EQ(shape.std_dev, b.noise_shapes.at(channel).std_dev);
  }
  EXPECT_EQ(a.outcome, b.outcome);
  EXPECT_EQ(a.reason, b.reason);
  EXPECT_EQ(a.alpha, b.alpha);
  EXPECT_EQ(a.alpha_covariance, b.alpha_covariance);
  EXPECT_EQ(a.covariance_with_choice, b.covariance_with_choice);
  EXPECT_EQ(a.bound_alpha_std, b.bound_alpha_std);
  EXPECT_EQ(a.covariance_reason, b.covariance_reason);
  EXPECT_EQ(a.noise.law, b.noise.law);
  // without a curve there is neither noise about it nor a range
  EXPECT_TRUE(a.alpha.size() == 0 ? b.noise.parameters.hasNaN() : a.noise.parameters == b.noise.parameters);
  ASSERT_EQ(a.noise_estimates.size(), b.noise_estimates.size());
  for (std::size_t i = 0; i < a.noise_estimates.size(); ++i)
    expect_same(a.noise_estimates[i], b.noise_estimates[i]);
  expect_same(a.sigma_theta_rad, b.sigma_theta_rad);
  expect_same(a.sigma_s_m, b.sigma_s_m);
  EXPECT_EQ(a.sigma_s_upper95_m, b.sigma_s_upper95_m);
  EXPECT_TRUE(a.alpha.size() == 0 ? std::isnan(b.range_min_m) : a.range_min_m == b.range_min_m);
  EXPECT_TRUE(a.alpha.size() == 0 ? std::isnan(b.range_max_m) : a.range_max_m == b.range_max_m);
  EXPECT_EQ(a.effects, b.effects);
  EXPECT_EQ(a.effects_range, b.effects_range);
  ASSERT_EQ(a.effects_covariance.has_value(), b.effects_covariance.has_value());
  if (a.effects_covariance) {
    EXPECT_EQ(a.effects_covariance->parameters, b.effects_covariance->parameters);
    EXPECT_EQ(a.effects_covariance->matrix, b.effects_covariance->matrix);
  }
  ASSERT_EQ(a.landmarks.size(), b.landmarks.size());
  for (std::size_t i = 0; i < a.landmarks.size(); ++i) {
    EXPECT_EQ(a.landmarks[i].recording, b.landmarks[i].recording);
    EXPECT_EQ(a.landmarks[i].label, b.landmarks[i].label);
    EXPECT_EQ(a.landmarks[i].position_m, b.landmarks[i].position_m);
    EXPECT_EQ(a.landmarks[i].covariance, b.landmarks[i].covariance);
  }
  ASSERT_EQ(a.stops.size(), b.stops.size());
  for (std::size_t i = 0; i < a.stops.size(); ++i) {
    EXPECT_EQ(a.stops[i].recording, b.stops[i].recording);
    EXPECT_EQ(a.stops[i].label, b.stops[i].label);
    EXPECT_EQ(a.stops[i].pose.x_m, b.stops[i].pose.x_m);
    EXPECT_EQ(a.stops[i].pose.y_m, b.stops[i].pose.y_m);
    EXPECT_EQ(a.stops[i].pose.heading_rad, b.stops[i].pose.heading_rad);
  }
  EXPECT_EQ(a.counts.read, b.counts.read);
  EXPECT_EQ(a.counts.used, b.counts.used);
  EXPECT_EQ(a.counts.dropped, b.counts.dropped);
  EXPECT_EQ(a.counts.cells_left_out, b.counts.cells_left_out);
  EXPECT_EQ(a.joint_nll, b.joint_nll);
  EXPECT_EQ(a.marginal_nll, b.marginal_nll);
  EXPECT_EQ(a.aic, b.aic);
  EXPECT_EQ(a.weakest_direction, b.weakest_direction);
  EXPECT_EQ(a.iterations, b.iterations);
  EXPECT_EQ(a.seconds, b.seconds);
}

TEST(CalibrationIo, OneAndSeveralReadBackAsWritten) {
  const TemporaryFolder folder;
  const std::string path = folder.file("c.json");
  Calibration pairs;
  pairs.kind = RecordingKind::pairs;
  pairs.outcome = Outcome::too_few_data;
  pairs.reason = "three readings, four unknowns";
  for (const auto& list :
       std::vector<std::vector<Calibration>>{{full_calibration()}, {full_calibration(), pairs}}) {
    save_calibrations(list, path);
    const std::vector<Calibration> loaded = load_calibrations(path);
    ASSERT_EQ(loaded.size(), list.size());
    for (std::size_t i = 0; i < list.size(); ++i) expect_same(list[i], loaded[i]);
  }
}

TEST(CalibrationIo, NanAndAbsentAreNull) {
  Calibration failed;
  failed.alpha = Eigen::Vector2d(std::numeric_limits<double>::quiet_NaN(), 1.0);
  failed.joint_nll = std::numeric_limits<double>::infinity();
  const std::string text = calibrations_to_json({failed});
  EXPECT_THAT(text, HasSubstr("\"sigma_theta_rad\": null"));
  EXPECT_THAT(text, HasSubstr("\"joint_nll\": null"));
  EXPECT_THAT(text, HasSubstr("\"covariance\": null"));
  const TemporaryFolder folder;
  folder.write("c.json", text);
  const Calibration loaded = load_calibrations(folder.file("c.json")).front();
  EXPECT_TRUE(std::isnan(loaded.alpha[0]));
  EXPECT_EQ(loaded.alpha[1], 1.0);
}

TEST(CalibrationIo, TheBestUsableMethodIsTheOneToUse) {
  const TemporaryFolder folder;
  const std::string path = folder.file("c.json");
  Calibration closed = full_calibration(), full = full_calibration(), marginal = full_calibration();
  closed.method = Method::closed_form;
  marginal.method = Method::marginal;
  save_calibrations({closed, full, marginal}, path);
  EXPECT_EQ(load_calibration(path).method, Method::marginal);
  marginal.outcome = Outcome::not_converged;
  full.outcome = Outcome::unbounded;
  save_calibrations({closed, full, marginal}, path);
  EXPECT_EQ(load_calibration(path).method, Method::closed_form);
  closed.outcome = Outcome::failed;
  save_calibrations({closed, full, marginal}, path);
  EXPECT_THROW(load_calibration(path), InputError);
}

TEST(CalibrationIo, ErrorsNameFileAndField) {
  const TemporaryFolder folder;
  const std::string path = folder.file("c.json");
  const auto error = [&](const std::string& text) -> std::string {
    folder.write("c.json", text);
    try {
      load_calibrations(path);
    } catch (const InputError& caught) {
      return std::string(caught.what()).substr(folder.path().size() + 1);
    }
    return "no error";
  };
  const auto with = [&](const std::string& rest) {
    return error(
        "{\"format\": \"rangecal-calibration/1\", \"method\": \"full\", \"outcome\": \"converged\", " + rest +
        "}");
  };
  const std::string noise = "\"noise\": {\"law\": \"f2\", \"parameters\": [0.01]}";
  EXPECT_EQ(with("\"alpha\": [0, 1], " + noise), "no error");
  EXPECT_EQ(error("").rfind("c.json: is not JSON", 0), 0u);
  EXPECT_EQ(error("[]"), "c.json: is not an object");
  EXPECT_EQ(error("{}"), "c.json: field 'format': is missing");
  EXPECT_EQ(error("{\"format\": \"x\"}"), "c.json: field 'format': is not rangecal-calibration/1");
  EXPECT_EQ(with(noise), "c.json: field 'alpha': is missing");
  EXPECT_EQ(with("\"alpha\": [0, \"one\"], " + noise), "c.json: field 'alpha[1]': is not a number");
  EXPECT_EQ(with("\"alpha\": [0, null], " + noise),
            "c.json: field 'alpha': is not finite, yet the outcome is usable");
  EXPECT_EQ(with("\"alpha\": [0, 1], \"order\": 2, " + noise),
            "c.json: field 'order': is not the number of alpha less one");
  EXPECT_EQ(with("\"alpha\": [0, 1], \"covariance\": [[1, 0]], " + noise),
            "c.json: field 'covariance': is not 2 rows");
  EXPECT_EQ(with("\"alpha\": [0, 1], \"covariance_with_choice\": [[1]], " + noise),
            "c.json: field 'covariance_with_choice': has 1 rows, not 2 to 100");
  EXPECT_EQ(with("\"alpha\": [0, 1], \"noise\": {\"law\": \"f9\", \"parameters\": [1]}"),
            "c.json: field 'noise.law': noise law is 'f9', not one of constant, f, f2, f3, d2, polynomial");
  EXPECT_EQ(with("\"alpha\": [0, 1], \"noise\": {\"law\": \"f2\", \"parameters\": [1, 2]}"),
            "c.json: field 'noise.parameters': one number belongs to this law");
  EXPECT_EQ(with("\"alpha\": [0, 1], \"bound_alpha_std\": [1], " + noise),
            "c.json: field 'bound_alpha_std': is not 2 numbers");
  const std::string effects =
      "\"effects\": {\"range_offset\": {\"offset_m\": 0.1}}, \"effects_covariance\": ";
  EXPECT_EQ(
      with("\"alpha\": [0, 1], " + effects + "{\"parameters\": [\"range_offset.size\"], \"matrix\": []}, " +
           noise),
      "c.json: field 'effects_covariance.parameters[0]': 'range_offset.size' is no EFFECT.PARAMETER of field "
      "'effects'");
  EXPECT_EQ(with("\"alpha\": [0, 1], " + effects +
                 "{\"parameters\": [\"range_offset.offset_m\"], \"matrix\": [[1]]}, " + noise),
            "c.json: field 'effects_covariance.matrix': is not 3 rows");
  for (const char* matrix :
       {"[[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "[[1, 0, 0.5], [0, 1, 0], [0, 0, 1]]",
        "[[1, 1e300, 0], [1e300, 1, 0], [0, 0, 1]]", "[[1, 0, 0], [0, null, 0], [0, 0, 1]]"})
    EXPECT_EQ(
        with("\"alpha\": [0, 1], " + effects +
             "{\"parameters\": [\"range_offset.offset_m\"], \"matrix\": " + matrix + "}, " + noise),
        "c.json: field 'effects_covariance.matrix': is no covariance: finite, symmetric, no negative variance");
  EXPECT_EQ(
      with("\"alpha\": [0, 1], " + effects +
           "{\"parameters\": [\"range_offset.offset_m\", \"range_offset.offset_m\"], \"matrix\": []}, " +
           noise),
      "c.json: field 'effects_covariance.parameters[1]': 'range_offset.offset_m' is named twice");
  for (const char* range : {"[1]", "[1, 2, 3]", "[null, 1]"})
    EXPECT_EQ(
        with("\"alpha\": [0, 1], \"effects_range\": {\"time_s\": " + std::string(range) + "}, " + noise),
        "c.json: field 'effects_range.time_s': is not two finite numbers, [from, to]");
  for (const char* bound : {"[null, 1]", "[-1, 1]"})
    EXPECT_EQ(with("\"alpha\": [0, 1], \"bound_alpha_std\": " + std::string(bound) + ", " + noise),
              "c.json: field 'bound_alpha_std': is not finite, or negative");
  EXPECT_EQ(with("\"alpha\": [0, 1], \"effects\": {\"range_offset\": {\"offset_m\": null}}, " + noise),
            "c.json: field 'effects.range_offset.offset_m': is not finite");
  EXPECT_EQ(with("\"alpha\": [0, 1], \"counts\": {\"dropped\": {\"zero\": 0.5}}, " + noise),
            "c.json: field 'counts.dropped.zero': is not a whole number");
  const auto spline = [&](const std::string& knots, const std::string& values,
                          const std::string& covariance) {
    return with("\"curve\": {\"family\": \"spline\", \"knots_m\": " + knots + ", \"values_m\": " + values +
                ", \"covariance\": " + covariance + ", \"degrees\": 3}, \"alpha\": [0, 1], " + noise);
  };
  const std::string none = "[[0, 0, 0], [0, 0, 0], [0, 0, 0]]";
  EXPECT_EQ(spline("[1, 3, 2]", "[1, 2, 3]", none),
            "c.json: field 'curve.knots_m': are not three numbers or more, in ascending order");
  EXPECT_EQ(spline("[1, 2, 3]", "[1, 2]", none),
            "c.json: field 'curve.values_m': has not one number for each knot");
  EXPECT_EQ(spline("[1, 2, 3]", "[1, 3, 2]", none),
            "c.json: field 'curve.values_m': are of a spline that does not rise everywhere");
  EXPECT_EQ(spline("[1, 2, 3]", "[1, 2, 3]", "[[1, 0], [0, 1]]"),
            "c.json: field 'curve.covariance': is not 3 rows");
  EXPECT_THAT(with("\"alpha\": [0, 1], \"covarience\": [[1, 0], [0, 1]], " + noise),
              StartsWith("c.json: field 'covarience': is unknown; known here: format, method, kind, "));
  EXPECT_EQ(with("\"alpha\": [0, 1], \"stops\": [{\"stop\": \"1\", \"x\": 0.5}], " + noise),
            "c.json: field 'stops[0].x': is unknown; known here: recording, stop, x_m, y_m, heading_rad");
}

TEST(CalibrationIo, AFileThatCannotBeWrittenIsNamedAndNothingIsLeft) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder.file("taken"));
  EXPECT_THROW(save_calibrations({full_calibration()}, folder.file("taken")), InputError);
  EXPECT_THROW(save_calibrations({full_calibration()}, folder.file("no/such/folder.json")), InputError);
  int files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder.path())) ++files;
  EXPECT_EQ(files, 1);
}

}  // namespace
}  // namespace rangecal
