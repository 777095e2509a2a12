// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/change/landmark_change_detector.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

#include "kalman/landmark_filter.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "support/landmark_reading.hpp"
#include "support/paper_scene.hpp"

namespace rangecal {
namespace {

using testing::reading_of;

struct Drive {
  int stops = 200, repeats = 2;
  double sigma_xy = 0.01, sigma_heading = 0.0;
  bool walk = false;
  double sigma_e = 0.01;  ///< noise sigma_e f^2
};

/// Stops on a Lissajous curve of 4 by 3 m, five cylinders about it, each seen from every stop.
Recording drive(const Drive& d, std::uint64_t seed) {
  Scene scene = testing::paper_scene();
  scene.noise.parameters[0] = d.sigma_e;
  scene.sigma_xy_m = d.sigma_xy;
  scene.sigma_heading_rad = d.sigma_heading;
  if (d.walk) scene.stop_error = StopErrorModel::random_walk;
  scene.repeats = d.repeats;
  for (int k = 0; k < d.stops; ++k) testing::add_stop(scene, testing::on_the_drive(k, 0.9 * k));
  testing::add_cylinders(scene);
  Recording recording = simulate(scene, seed);
  for (Stop& stop : recording.stops) {
    stop.sigma_xy_m = d.sigma_xy;
    stop.sigma_heading_rad = d.sigma_heading;
  }
  return recording;
}

/// The sensor of the scenes, its curve known to half a percent or so.
Calibration reference(double known = 1.0) {
  Calibration c;
  c.outcome = Outcome::converged;
  c.alpha = testing::paper_scene().alpha;
  c.alpha_covariance = Eigen::Vector3d(9e-6, 9e-6, 1e-6).asDiagonal() * (known * known);
  c.noise.parameters[0] = 0.01;
  c.sigma_theta_rad = Estimate{0.0087, std::nullopt};
  c.range_min_m = 0.5;
  c.range_max_m = 4.5;
  return c;
}

TEST(LandmarkFilter, HandWorked) {
  // f = d, s = 0.1, sigma_theta = 0.1, a stop exact at the origin. A reading of 2 m at bearing 0 puts a
  // landmark of radius 0 at (2, 0) with variances 0.1^2 along and (2 * 0.1)^2 across. The second, 2.1 m at
  // 0.3: innovations 0.1 and 0.3, variances 0.01 + 0.01 and 0.04 / 4 + 0.01.
  Calibration line;
  line.alpha = Eigen::Vector2d(0.0, 1.0);
  line.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 0.1)};
  line.sigma_theta_rad = Estimate{0.1, std::nullopt};
  LandmarkFilter filter(line);
  filter.start({}, Eigen::Matrix3d::Zero(), false, false);
  EXPECT_TRUE(filter.take("A", 0.0, 2.0, 0.0).placed);
  EXPECT_LT((filter.x.tail<2>() - Eigen::Vector2d(2.0, 0.0)).norm(), 1e-12);
  EXPECT_LT((filter.P.bottomRightCorner<2, 2>().diagonal() - Eigen::Vector2d(0.01, 0.04)).norm(), 1e-12);
  const LandmarkFilter::Taken taken = filter.take("A", 0.0, 2.1, 0.3);
  EXPECT_NEAR(taken.range.nu, 0.1, 1e-12);
  EXPECT_NEAR(taken.range.S, 0.02, 1e-12);
  EXPECT_NEAR(taken.bearing.nu, 0.3, 1e-12);
  EXPECT_NEAR(taken.bearing.S, 0.02, 1e-12);
  // halfway, as both readings weigh alike: x 2.05, y 2 * 0.15
  EXPECT_LT((filter.x.tail<2>() - Eigen::Vector2d(2.05, 0.3)).norm(), 1e-12);
}

/// f = d, s = 0.1 everywhere, sigma_theta = 0.1.
Calibration plain_line() {
  Calibration line;
  line.outcome = Outcome::converged;
  line.alpha = Eigen::Vector2d(0.0, 1.0);
  line.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 0.1)};
  line.sigma_theta_rad = Estimate{0.1, std::nullopt};
  line.range_max_m = 4.0;
  return line;
}

TEST(LandmarkFilter, PlacesNoLandmarkByAnInverseThatDidNotSettle) {
  // A curve on which Newton's method goes to and fro between 3 and 1 (InvertNear.ReturnsNoStepThatIsStillUnderWay): the
  // landmark stays unknown until a reading of it has a distance, 2.5 m here.
  Calibration wavy = plain_line();
  wavy.alpha = Eigen::VectorXd{{7.0, 143.0, -180.0, 110.0, -30.0, 3.0}} / 23.0;
  LandmarkFilter filter(wavy);
  filter.start({}, Eigen::Matrix3d::Zero(), false, false);
  EXPECT_FALSE(filter.take("A", 0.0, 3.0, 0.0).usable);
  EXPECT_TRUE(filter.labels.empty());
  EXPECT_TRUE(filter.take("A", 0.0, evaluate_polynomial(wavy.alpha, 2.5), 0.0).placed);
  EXPECT_NEAR(filter.x.tail<2>().x(), 2.5, 1e-12);
}

TEST(LandmarkFilter, DoesNotFollowWhatIsTooFarOffForAnythingLinear) {
  // 0.2 m off, the state moves halfway, as in HandWorked; more than 1e3 standard deviations off, the innovation is told
  // and the state stays; where its square is no number any more nothing is usable.
  LandmarkFilter filter(plain_line());
  filter.start({}, Eigen::Matrix3d::Zero(), false, false);
  filter.take("A", 0.0, 2.0, 0.0);
  LandmarkFilter near = filter, far = filter, beyond = filter;
  near.take("A", 0.0, 2.2, 0.0);
  EXPECT_NEAR(near.x.tail<2>().x(), 2.1, 1e-12);
  for (const double wild : {200.0, 1e9}) {
    const LandmarkFilter::Taken taken = far.take("A", 0.0, wild, 0.0);
    EXPECT_TRUE(taken.usable);
    EXPECT_NEAR(taken.range.nu, wild - 2.0, 1e-6);
    EXPECT_EQ(taken.range.gain.norm(), 0.0);
    EXPECT_NEAR(far.x.tail<2>().x(), 2.0, 1e-12);
  }
  for (const double wild : {1e200, 1e308}) {
    EXPECT_FALSE(beyond.take("A", 0.0, wild, 0.0).usable);
    EXPECT_FALSE(beyond.take("B", 0.0, wild, 0.0).usable);
  }
  EXPECT_EQ(beyond.x, filter.x);
  EXPECT_EQ(beyond.P, filter.P);
}

TEST(LandmarkFilter, InnovationsAreWhiteAndOfTheirVariance) {
  // 12 drives of each kind, 1990 innovations each: mean square 1 within 4 sqrt(2 / N) and a percent for the
  // filter being linear; lag one within 4 / sqrt(N).
  for (const Drive& d : {Drive{}, Drive{200, 2, 0.01, 0.01, false}, Drive{200, 2, 0.01, 0.005, true}}) {
    double square = 0.0, lag = 0.0, bearing = 0.0, before = 0.0, count = 0.0;
    for (std::uint64_t repeat = 0; repeat < 12; ++repeat) {
      const Recording r = drive(d, seed_from("innovations", {repeat}));
      Calibration known = reference();
      Random random(seed_from("innovations curve", {repeat}));
      for (Eigen::Index i = 0; i < 3; ++i)
        known.alpha[i] += std::sqrt((*known.alpha_covariance)(i, i)) * random.normal();
      LandmarkFilter filter(known);
      int stop = -1;
      for (std::size_t i = 0; i < r.readings.size(); ++i) {
        const LandmarkReading reading = reading_of(r, i);
        if (r.readings.stop[i] != stop) {
          const double xy = d.sigma_xy * d.sigma_xy;
          filter.start(reading.stop.commanded,
                       Eigen::Vector3d(xy, xy, d.sigma_heading * d.sigma_heading).asDiagonal(),
                       d.walk && stop >= 0, false);
          stop = r.readings.stop[i];
        }
        const auto taken =
            filter.take(reading.landmark, reading.radius_m, reading.range_m, reading.bearing_rad);
        ASSERT_TRUE(taken.usable);
        if (taken.placed) continue;
        const double z = taken.range.nu / std::sqrt(taken.range.S);
        square += z * z;
        lag += z * before;
        bearing += taken.bearing.nu * taken.bearing.nu / taken.bearing.S;
        before = z;
        count += 1.0;
      }
    }
    EXPECT_NEAR(square / count, 1.0, 4.0 * std::sqrt(2.0 / count) + 0.01) << d.sigma_heading << d.walk;
    EXPECT_NEAR(bearing / count, 1.0, 4.0 * std::sqrt(2.0 / count) + 0.01) << d.sigma_heading << d.walk;
    EXPECT_NEAR(lag / count, 0.0, 4.0 / std::sqrt(count)) << d.sigma_heading << d.walk;
  }
}

/// Alarms over a drive without a change, each blinding the watch for 10 readings; N = 1000. The reference's
/// curve is off by what its covariance says.
int alarms_in(const Drive& d, std::uint64_t repeat) {
  const Recording r = drive(d, seed_from("watch run length", {repeat}));
  Calibration known = reference();
  Random random(seed_from("watch curve", {repeat}));
  for (Eigen::Index i = 0; i < 3; ++i)
    known.alpha[i] += std::sqrt((*known.alpha_covariance)(i, i)) * random.normal();
  ChangeOptions options;
  options.run_length = 1000.0;
  options.naming = 10;
  LandmarkChangeDetector watch(known, d.walk, options);
  int alarms = 0;
  for (std::size_t i = 0; i < r.readings.size(); ++i) {
    const auto alarm = watch.add(reading_of(r, i));
    alarms += alarm && !alarm->named;
  }
  return alarms;
}

TEST(LandmarkChangeDetector, RunLengthIsAtLeastAsStated) {
  // 100 streams of 2000 readings, at most 200 alarms expected of a Poisson number: 200 + 4 sqrt(200) = 257;
  // and not fewer for no reason, half of them: 100 - 4 sqrt(100). One of 80 000 readings, in which the filter
  // grows sure of what it has seen: 80 + 4 sqrt(80) = 116.
  for (const bool walk : {false, true}) {
    Drive d{200, 2, 0.01, walk ? 0.005 : 0.0, walk};
    int alarms = 0;
    for (std::uint64_t repeat = 0; repeat < 100; ++repeat) alarms += alarms_in(d, repeat);
    EXPECT_LT(alarms, 257) << walk;
    EXPECT_GT(alarms, 60) << walk;
    d.stops = 8000;
    EXPECT_LT(alarms_in(d, 1000), 116) << walk;
  }
}

/// Readings from stop 100 on changed; the alarm that is named first.
std::optional<ChangeAlarm> named_in(const Recording& r, bool walk,
                                    const std::function<double(double, double)>& changed) {
  LandmarkChangeDetector watch(reference(), walk);
  std::optional<ChangeAlarm> named;
  for (std::size_t i = 0; i < r.readings.size() && !named; ++i) {
    LandmarkReading reading = reading_of(r, i);
    if (r.readings.stop[i] >= 100) reading.range_m = changed(reading.range_m, reading.bearing_rad);
    const auto alarm = watch.add(reading);
    if (alarm && alarm->named) named = alarm;
  }
  return named;
}

TEST(LandmarkChangeDetector, NamesWhatChangedWithItsSize) {
  struct Case {
    ChangeKind kind;
    double size;
    std::function<double(double, double)> changed;
  };
  Random random(seed_from("spread doubled"));
  const std::vector<Case> cases{
      {ChangeKind::window, 0.03, [](double y, double) { return y + 0.03; }},
      {ChangeKind::baseline, -0.04, [](double y, double) { return 0.96 * y; }},
      {ChangeKind::pointing, 0.015, [](double y, double) { return y + 0.015 * y * y; }},
      {ChangeKind::encoder, 0.04, [](double y, double b) { return y + 0.04 * std::cos(b - 1.0); }},
      // three times the variance on top of one: the spread doubled
      {ChangeKind::noise, std::log(2.0),
       [&](double y, double) { return random.normal(y, std::sqrt(3.0) * 0.01 * y * y); }}};
  for (const bool walk : {false, true}) {
    const Drive d{200, 2, 0.01, walk ? 0.005 : 0.0, walk};
    for (const Case& c : cases) {
      int found = 0, named = 0, covered = 0, since = 0, phases = 0;
      for (std::uint64_t repeat = 0; repeat < 20; ++repeat) {
        const auto alarm = named_in(drive(d, seed_from("watch change", {repeat})), walk, c.changed);
        if (!alarm) continue;
        ++found;
        named += alarm->kind == c.kind;
        covered += alarm->kind == c.kind && std::abs(alarm->size - c.size) < 3.0 * alarm->std_dev;
        since += std::abs(alarm->since - 1000) <= 100;
        EXPECT_EQ(alarm->phase_rad.has_value(), alarm->kind == ChangeKind::encoder);
        if (const auto& phase = alarm->phase_rad)
          phases += std::abs(phase->value - 1.0) < 3.0 * phase->std_dev.value_or(0.0);
      }
      EXPECT_EQ(found, 20) << to_string(c.kind);
      EXPECT_GE(named, 17) << to_string(c.kind);
      EXPECT_GE(covered, named - 2) << to_string(c.kind);  // 0.997 each: more than 2 beyond once in 10^5
      EXPECT_GE(since, 15) << to_string(c.kind);
      EXPECT_GE(phases, c.kind == ChangeKind::encoder ? named - 2 : 0);
    }
  }
}

/// False alarms are not waited for: one in 1e8 readings at most.
ChangeOptions rarely() {
  ChangeOptions options;
  options.run_length = 1e8;
  return options;
}

TEST(LandmarkChangeDetector, PlacesAndNamesAStepOfAHundredStandardDeviations) {
  // Noise 0.0005 f^2, 0.5 mm at 1 m, stops known to 0.5 mm. An offset of 10 cm, or 6 %, from reading 1000 on, which
  // opens a stop, is 60 to 110 standard deviations at the first reading: likelihood ratios of e^1000 and more. That
  // reading raises the alarm. The size is that of the linear model, good to 2 %; along a walk, where the pose follows
  // the step for a while, to 8 %.
  for (const bool walk : {false, true})
    for (const bool share : {false, true}) {
      const Drive d{200, 2, 0.0005, walk ? 0.0005 : 0.0, walk, 0.0005};
      Calibration precise = reference();
      precise.noise.parameters[0] = d.sigma_e;
      for (std::uint64_t repeat = 0; repeat < 5; ++repeat) {
        const Recording r = drive(d, seed_from("watch hundred", {repeat}));
        LandmarkChangeDetector watch(precise, walk, rarely());
        std::optional<ChangeAlarm> raised, named;
        for (std::size_t i = 0; i < r.readings.size() && !named; ++i) {
          LandmarkReading reading = reading_of(r, i);
          if (r.readings.stop[i] >= 100)
            reading.range_m = share ? 1.06 * reading.range_m : reading.range_m + 0.1;
          const auto alarm = watch.add(reading);
          if (alarm) (alarm->named ? named : raised) = alarm;
        }
        ASSERT_TRUE(raised && named);
        EXPECT_EQ(raised->reading, 1001);
        EXPECT_NEAR(static_cast<double>(raised->since), 1000.0, 200.0);  // by one reading
        EXPECT_EQ(named->since, 1000);                                   // by 301
        EXPECT_EQ(named->kind, share ? ChangeKind::baseline : ChangeKind::window);
        const double size = share ? 0.06 : 0.1;
        EXPECT_NEAR(named->size, size, (walk ? 0.08 : 0.02) * size) << repeat;
        EXPECT_GT(named->probability, 0.999);
      }
    }
}

TEST(LandmarkChangeDetector, AWildReadingAlarmsOnceAndTheWatchGoesOn) {
  // 1e12 m is an alarm like any other, 1e308 m has no square that could be counted and is passed over. Neither moves the
  // map: an offset of 3 cm from stop 150 on is found as if there had been none.
  const Recording r = drive(Drive{300}, seed_from("watch wild"));
  LandmarkChangeDetector watch(reference(), false, rarely());
  std::vector<ChangeAlarm> raised, named;
  for (std::size_t i = 0; i < r.readings.size() && named.size() < 2; ++i) {
    LandmarkReading reading = reading_of(r, i);
    if (r.readings.stop[i] >= 150) reading.range_m += 0.03;
    if (i == 604) reading.range_m = 1e12;
    if (i == 700 || i == 1200) reading.range_m = 1e308;
    if (const auto alarm = watch.add(reading)) (alarm->named ? named : raised).push_back(*alarm);
  }
  ASSERT_EQ(raised.size(), 2u);
  EXPECT_EQ(raised[0].reading, 605);
  EXPECT_EQ(raised[0].since, 600);  // its stop: beside it nothing else counts
  EXPECT_GT(raised[1].reading, 1500);
  ASSERT_EQ(named.size(), 2u);
  EXPECT_TRUE(std::isfinite(named[0].size) && std::isfinite(named[0].std_dev));
  EXPECT_EQ(named[1].kind, ChangeKind::window);
  EXPECT_NEAR(named[1].size, 0.03, 4.0 * named[1].std_dev);
  LandmarkChangeDetector again(reference(), false, rarely());
  again.restore(watch.to_json());
  EXPECT_EQ(again.to_json(), watch.to_json());
}

TEST(LandmarkChangeDetector, AChangeThatStaysAlarmsAgainInItsSize) {
  // What the first alarm told is taken back from the map, or the next would tell of a third less.
  for (const bool walk : {false, true}) {
    const Recording r = drive(Drive{600, 2, 0.01, walk ? 0.005 : 0.0, walk}, seed_from("watch again"));
    LandmarkChangeDetector watch(reference(), walk);
    std::vector<ChangeAlarm> named;
    for (std::size_t i = 0; i < r.readings.size(); ++i) {
      LandmarkReading reading = reading_of(r, i);
      if (r.readings.stop[i] >= 100) reading.range_m += 0.03;
      if (const auto alarm = watch.add(reading); alarm && alarm->named) named.push_back(*alarm);
    }
    EXPECT_GE(named.size(), 8u);
    int held = 0;
    for (const ChangeAlarm& alarm : named) {
      EXPECT_EQ(alarm.kind, ChangeKind::window) << alarm.reading;
      held += std::abs(alarm.size - 0.03) < 3.0 * alarm.std_dev;
    }
    EXPECT_GE(held, static_cast<int>(named.size()) - 1) << walk;
  }
}

TEST(LandmarkChangeDetector, StateGoesOnAndBadInputIsRefused) {
  const Drive d{120, 2, 0.01, 0.005, true};
  const Recording r = drive(d, seed_from("watch state"));
  ChangeOptions often;
  often.run_length = 200.0;  // alarms while it is saved, too
  LandmarkChangeDetector whole(reference(), true, often), part(reference(), true, often);
  for (std::size_t i = 0; i < r.readings.size(); ++i) {
    LandmarkReading reading = reading_of(r, i);
    if (i > 600) reading.range_m *= 1.05;
    if (i % 97 == 0) {
      LandmarkChangeDetector next(reference(), true, often);
      next.restore(part.to_json());
      part = std::move(next);
    }
    const auto a = whole.add(reading), b = part.add(reading);
    ASSERT_EQ(a.has_value(), b.has_value()) << i;
    if (a) {
      EXPECT_EQ(a->since, b->since);
    }
  }
  EXPECT_EQ(part.to_json(), whole.to_json());
  EXPECT_EQ(whole.readings(), static_cast<std::int64_t>(r.readings.size()));
  LandmarkReading bad = reading_of(r, 0);
  for (const double value : {std::nan(""), 0.0, -1.0}) {
    bad.range_m = value;
    EXPECT_FALSE(part.add(bad));
  }
  EXPECT_THROW(part.restore("{}"), InputError);
  std::string broken = whole.to_json();
  broken.replace(broken.find("\"x\":["), 5, "\"x\":[1,");
  EXPECT_THROW(part.restore(broken), InputError);
  Calibration pairs = reference();
  pairs.sigma_theta_rad.reset();
  EXPECT_THROW(LandmarkChangeDetector{pairs}, InputError);
  EXPECT_THROW(LandmarkChangeDetector{Calibration{}}, InputError);
}

TEST(LandmarkChangeDetector, RefusesStatesThatNoReadingsMake) {
  using State = nlohmann::json;
  const Recording r = drive(Drive{40}, seed_from("watch refuses"));
  LandmarkChangeDetector sound(reference()), next(reference());
  for (std::size_t i = 0; i < r.readings.size(); ++i) sound.add(reading_of(r, i));
  const auto refusal = [&](const std::function<void(State&)>& breaking) -> std::string {
    State state = State::parse(sound.to_json());
    breaking(state);
    try {
      next.restore(state.dump());
    } catch (const InputError& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_EQ(refusal([](State&) {}), "none");
  // P is kept column by column: [1] is P(1, 0), [size of x] is P(0, 1)
  EXPECT_EQ(refusal([](State& s) { s["P"][1] = s["P"][1].get<double>() + 1e-3; }),
            "field 'P': is no covariance: it is not symmetric");
  EXPECT_EQ(refusal([](State& s) { s["P"][1] = s["P"][s["x"].size()] = 1.0; }),
            "field 'P': is no covariance: it is not positive");
  EXPECT_NE(refusal([](State& s) { s["P"][0] = -1e-9; }), "none");
  EXPECT_EQ(refusal([](State& s) { s["opened_at"] = s["tested"].get<int>() + 1; }),
            "field 'opened_at': is beyond 'tested'");
  EXPECT_NE(refusal([](State& s) { s["naming_left"] = 301; }), "none");
  EXPECT_NE(refusal([](State& s) { s["naming_left"] = 10, s["onsets"] = State::array(); }), "none");
  EXPECT_EQ(refusal([](State& s) { s.erase("place"); }), "field 'place': is missing");
  EXPECT_EQ(refusal([](State& s) { s["onsets"][0]["sinse"] = 1; }),
            "field 'onsets[0].sinse': is unknown; known here: since, until, numbers, beta");
  const std::string onsets = "field 'onsets[0]': holds what no readings make";
  EXPECT_EQ(refusal([](State& s) { s["onsets"][0]["numbers"][0] = 0.0; }), onsets);    // w
  EXPECT_EQ(refusal([](State& s) { s["onsets"][0]["numbers"][11] = -1.0; }), onsets);  // I
}

TEST(LandmarkChangeDetector, RefusesStopsAndLandmarksThatAreNotFinite) {
  const Recording r = drive(Drive{40, 1}, seed_from("watch not finite"));
  for (const bool walk : {false, true}) {
    LandmarkChangeDetector watch(reference(0.1), walk);
    for (std::size_t i = 0; i < 20; ++i) watch.add(reading_of(r, i));
    const std::string before = watch.to_json();
    const auto refusal = [&](const std::function<void(LandmarkReading&)>& breaking) -> std::string {
      LandmarkReading reading = reading_of(r, 20);
      reading.stop.label = "next";
      reading.landmark = "M";
      breaking(reading);
      try {
        watch.add(reading);
      } catch (const InputError& error) {
        return error.what();
      }
      return "none";
    };
    const double nan = std::nan(""), inf = std::numeric_limits<double>::infinity();
    const std::string pose = "LandmarkChangeDetector: stop 'next': its pose is not finite",
                      accuracy =
                          "LandmarkChangeDetector: stop 'next': its accuracy is negative or not finite",
                      radius = "LandmarkChangeDetector: landmark 'M': its radius is negative or not finite";
    EXPECT_EQ(refusal([&](LandmarkReading& l) { l.stop.commanded.x_m = nan; }), pose);
    EXPECT_EQ(refusal([&](LandmarkReading& l) { l.stop.commanded.y_m = inf; }), pose);
    EXPECT_EQ(refusal([&](LandmarkReading& l) { l.stop.commanded.heading_rad = nan; }), pose);
    EXPECT_EQ(refusal([&](LandmarkReading& l) { l.stop.sigma_xy_m = nan; }), accuracy);
    EXPECT_EQ(refusal([&](LandmarkReading& l) { l.stop.sigma_heading_rad = -0.1; }), accuracy);
    EXPECT_EQ(refusal([&](LandmarkReading& l) { l.radius_m = nan; }), radius);
    Stop passed = r.stops[5];
    passed.label = "next";
    passed.commanded.x_m = nan;
    if (walk) {
      EXPECT_THROW(watch.pass(passed), InputError);
    }
    EXPECT_EQ(watch.to_json(), before);
    EXPECT_EQ(refusal([](LandmarkReading&) {}), "none");
  }
}

TEST(LandmarkChangeDetector, MemoryDoesNotGrow) {
  const Recording r = drive(Drive{3000, 1}, seed_from("watch memory"));
  LandmarkChangeDetector watch(reference(0.1));
  std::size_t after_1100 = 0;  // stops: every kind of onset is there, 32 each of lives 32 to 256, and of 512
  for (std::size_t i = 0; i < r.readings.size(); ++i) {
    watch.add(reading_of(r, i));
    if (i == 5 * 1100) after_1100 = watch.to_json().size();
  }
  EXPECT_LT(static_cast<double>(watch.to_json().size()), 1.1 * static_cast<double>(after_1100));
}

}  // namespace
}  // namespace rangecal
