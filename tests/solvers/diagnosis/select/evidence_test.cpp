// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/evidence.hpp"

#include <gtest/gtest.h>

#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/quadrature/gauss_kronrod.hpp>
#include <cmath>

#include "diagnosis/generic_effect.hpp"
#include "solvers/diagnosis/made_recordings.hpp"
#include "solvers/diagnosis/select/made_worlds.hpp"

namespace rangecal::diagnosis {
namespace {

using boost::math::quadrature::gauss_kronrod;

class Evidence : public ::testing::Test {
 protected:
  static testing::SeedFit& seed() {
    static testing::SeedFit fit(testing::recording_with({}, "Evidence.Clean"));
    return fit;
  }
  /// A fit of one effect whose parameters are `values`, of that covariance.
  static Fit fit_of(const Effect* effect, const Eigen::VectorXd& values, const Eigen::MatrixXd& covariance) {
    Fit fit = seed().fit;
    fit.model = {{effect, values}};
    fit.free.clear();
    for (int j = 0; j < values.size(); ++j) fit.free.push_back({0, j, FreeParameter::Acts::mean});
    fit.covariance = covariance;
    return fit;
  }
  SelectionPriors priors;
};

TEST_F(Evidence, PriorMassesOfSetsAreThoseWorkedByHand) {
  const Effect *tilt = find_effect("tilt"), *offset = find_effect("bearing_offset");
  const MemberCounts counts{40.0, 20.0};
  SelectionPriors half;
  half.generic = 0.5;
  half.further_member = 0.25;
  EXPECT_NEAR(log_prior_mass({}, 0, counts, half), 0.0, 1e-15);
  EXPECT_NEAR(log_prior_mass({{tilt, {}}}, 0, counts, half), std::log(0.5 / 40.0), 1e-12);
  EXPECT_NEAR(log_prior_mass({{tilt, {}}, {offset, {}}}, 0, counts, half),
              std::log(0.25 * 0.5 * 0.5 / 1600.0), 1e-12);
  EXPECT_NEAR(log_prior_mass({{tilt, {}}, {offset, {}}}, 1, counts, half), std::log(0.5 / 40.0), 1e-12)
      << "what bookkeeping found is in every set";
  GenericEffect curve(
      CurveChannel::range, "range", "range", [](const auto& at) { return at.d; }, {{1.0, 2.0}, false, 0.0},
      Eigen::MatrixXd::Identity(2, 2), 0.01);
  EXPECT_NEAR(log_prior_mass({{&curve, {}}}, 0, counts, half), std::log(0.5 / 20.0), 1e-12);
}

TEST_F(Evidence, PriorsOfPlacesAndTimesIntegrateToOne) {
  const auto integral = [&](const char* id, std::size_t index) {
    const EffectParameter& p = find_effect(id)->info().parameters.at(index);
    EXPECT_FALSE(p.linear) << id;
    return gauss_kronrod<double, 61>::integrate(
        [&](double u) { return std::exp(u + log_prior_density(p, p.low, p.high, std::exp(u), priors)); },
        std::log(p.low), std::log(p.high));
  };
  EXPECT_NEAR(integral("warmup_drift", 2), 1.0, 1e-9) << "of any magnitude: uniform in its logarithm";
  EXPECT_NEAR(integral("cyclic_error", 2), 1.0, 1e-9) << "2 to 140: uniform";
}

TEST_F(Evidence, SizesThatAreAlikeHaveOneScale) {
  // Student's t of two degrees of freedom as a mixture: theta_i ~ N(0, v typical^2), all of one v of density exp(-1 / v) / v^2
  const Effect& offsets = *find_effect("device_offset");
  ASSERT_TRUE(offsets.info().sizes_alike);
  const double typical = offsets.info().parameters.front().typical;
  Eigen::VectorXd values = Eigen::VectorXd::Zero(12);
  values.head(3) = typical * Eigen::Vector3d(8.0, -6.0, 10.0);
  const double mixed = gauss_kronrod<double, 61>::integrate(
      [&](double u) {  // ln v
        const double v = std::exp(u);
        double density = std::exp(-1.0 / v) / v;
        for (int i = 0; i < 3; ++i)
          density *= boost::math::pdf(boost::math::normal(0.0, typical * std::sqrt(v)), values[i]);
        return density;
      },
      -8.0, 20.0, 15, 1e-12);
  const auto density_of = [&](const std::vector<int>& indices) {
    return log_prior_density(seed().rows, offsets, indices, values, priors);
  };
  EXPECT_NEAR(density_of({0, 1, 2}), std::log(mixed), 1e-8);
  EXPECT_NEAR(density_of({0}),
              log_prior_density(offsets.info().parameters[0], -10.0, 10.0, values[0], priors), 1e-12)
      << "of one it is that of a size of its own";
}

TEST(CalibrationVolume, GrowsByLnTwoForEveryCoefficientWhereTheNoiseIsTwiceAsLarge) {
  const testing::SeedFit pairs(testing::depth_camera(300, 0.0, 0.0, "CalibrationVolume"));
  Fit twice = pairs.fit;
  twice.state.noise.parameters *= 2.0;
  EXPECT_NEAR(log_calibration_volume(pairs.rows, twice) - log_calibration_volume(pairs.rows, pairs.fit),
              static_cast<double>(pairs.fit.state.alpha.size()) * std::log(2.0), 1e-6);
}

TEST_F(Evidence, OfOneSizeIsTheIntegralOverIt) {
  const Effect* offset = find_effect("bearing_offset");
  const double typical = offset->info().parameters[0].typical;
  const boost::math::students_t law(priors.size_dof);
  for (const double estimate : {0.3, 1.0, 5.0}) {
    const double sigma = 0.05 * typical;
    const Fit fit = fit_of(offset, Eigen::VectorXd::Constant(1, estimate * typical),
                           Eigen::MatrixXd::Constant(1, 1, sigma * sigma));
    const double integral = gauss_kronrod<double, 61>::integrate(
        [&](double x) {
          return std::exp(-0.5 * std::pow((x - estimate * typical) / sigma, 2)) *
                 boost::math::pdf(law, x / typical) / typical;
        },
        (estimate * typical) - 8.0 * sigma, (estimate * typical) + 8.0 * sigma);
    EXPECT_NEAR(log_parameter_volume(seed().rows, fit, 0, seed().options, priors), std::log(integral), 0.01)
        << estimate;
  }
}

TEST_F(Evidence, AParameterThatTheReadingsSayNothingOfCostsNothing) {
  const Effect* offset = find_effect("bearing_offset");
  const double typical = offset->info().parameters[0].typical;
  const Fit fit =
      fit_of(offset, Eigen::VectorXd::Zero(1), Eigen::MatrixXd::Constant(1, 1, 1e8 * typical * typical));
  const double volume = log_parameter_volume(seed().rows, fit, 0, seed().options, priors);
  EXPECT_NEAR(volume, std::log(std::sqrt(2.0 * std::numbers::pi) / std::sqrt(8.0)), 0.01)
      << "a normal prior in place of Student's t, whose density at 0 is 1 / sqrt(8) of the typical size";
}

TEST_F(Evidence, AParameterThatTheReadingsSayNothingOfLeavesTheOthersAsTheyAre) {
  // Of the first the readings know 1e-8 of what its prior does, which is all that then holds it: the second is known as if the
  // first were given, and by its own prior.
  const Effect* eccentricity = find_effect("encoder_eccentricity");
  const double typical = eccentricity->info().parameters[0].typical, unknown = 1e8 * typical,
               known = 0.01 * typical;
  const double correlation = 0.9;
  Eigen::MatrixXd C(2, 2);
  C << unknown * unknown, correlation * unknown * known, correlation * unknown * known, known * known;
  const Fit fit = fit_of(eccentricity, Eigen::VectorXd::Zero(2), C);
  const double density = 1.0 / std::sqrt(8.0);  // of Student's t at 0, in typical sizes
  const double of_readings = 1e-4 * (1.0 - correlation * correlation);
  EXPECT_NEAR(
      log_parameter_volume(seed().rows, fit, 0, seed().options, priors),
      std::log(2.0 * std::numbers::pi * density * density * std::sqrt(of_readings / (1.0 + of_readings))),
      1e-7);
}

TEST_F(Evidence, OfACurveIsTheIntegralOverItsSize) {
  const double c = 0.02, S = 1e-5, tau = c;  // the likeliest of the sizes tried: tau^2 + S = c^2 nearly
  GenericEffect curve(
      CurveChannel::range, "range", "range", [](const auto& at) { return at.d; }, {{1.0, 2.0}, false, 0.0},
      Eigen::MatrixXd::Identity(2, 1), 0.01);
  const Fit fit = fit_of(&curve, Eigen::VectorXd::Constant(1, c), Eigen::MatrixXd::Constant(1, 1, S));
  const double integral = gauss_kronrod<double, 61>::integrate(
      [&](double x) {
        return std::exp(-0.5 * (x - c) * (x - c) / S) * boost::math::pdf(boost::math::normal(0.0, tau), x);
      },
      c - 10.0 * std::sqrt(S), c + 10.0 * std::sqrt(S));
  EXPECT_NEAR(log_parameter_volume(seed().rows, fit, 0, seed().options, priors), std::log(integral), 0.02);
  curve.choices = 10.0;
  EXPECT_NEAR(log_parameter_volume(seed().rows, fit, 0, seed().options, priors), std::log(0.1 * integral),
              0.02);
}

TEST_F(Evidence, CountsTheNamesThatARecordingCanHold) {
  const MemberCounts counts = count_members(seed().rows, 0.0);
  EXPECT_EQ(counts.places, 1.0);
  double names = 0.0;
  for (const Effect* effect : effects_of(seed().rows.context)) {
    const EffectKind kind = effect->info().kind;
    names += kind != EffectKind::grid && kind != EffectKind::label && kind != EffectKind::detection &&
             effect->missing(seed().rows.context).empty();
  }
  EXPECT_EQ(counts.names, names);
  EXPECT_GT(names, 20.0);
}

}  // namespace
}  // namespace rangecal::diagnosis
