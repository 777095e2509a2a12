// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/change/change_detector.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

Calibration pairs_reference() {
  Calibration c;
  c.outcome = Outcome::converged;
  c.alpha = Eigen::Vector3d(0.0525, 0.8838, 0.0584);
  c.noise.parameters[0] = 0.01;
  c.range_min_m = 0.5;
  c.range_max_m = 4.0;
  return c;
}

/// A reading at a distance of the range, with the mean and spread changed.
double read(Random& random, double d, double offset = 0.0, double scale = 1.0, double disparity = 0.0,
            double spread = 1.0) {
  const Calibration c = pairs_reference();
  const double f = evaluate_polynomial(c.alpha, d);
  return random.normal(scale * f + offset + disparity * f * f, spread * 0.01 * f * f);
}

/// The first alarm that is named within `most` readings, each added by next(i); else what the last reading gave.
template <typename Next>
std::optional<ChangeAlarm> first_named(int most, Next next) {
  std::optional<ChangeAlarm> alarm;
  for (int i = 0; i < most && !(alarm && alarm->named); ++i) alarm = next(i);
  return alarm;
}

TEST(ChangeDetector, RatioHandWorked) {
  // f = d, s = 0.1: the offset looked for upwards is 0.5 s. A reading one s high has l = 0.5 * 1 - 0.5^2 / 2 = 0.375, so
  // that R = (1 + 0) e^0.375 = 1.454991; a second one (1 + 1.454991) * 1.454991 = 3.571991. S = 2 * 0.375.
  Calibration line = pairs_reference();
  line.alpha = Eigen::Vector2d(0.0, 1.0);
  line.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 0.1)};
  ChangeDetector detector(line);
  detector.add(1.0, 1.1);
  detector.add(2.0, 2.1);
  EXPECT_NEAR(detector.state()[5], 3.571991, 1e-5);
  EXPECT_NEAR(detector.state()[6], 0.75, 1e-12);
}

/// False alarms are not waited for: one in 1e9 readings at most.
ChangeOptions seldom() {
  ChangeOptions options;
  options.run_length = 1e9;
  return options;
}

/// f = d, s = 0.1 everywhere.
Calibration line_reference() {
  Calibration line = pairs_reference();
  line.alpha = Eigen::Vector2d(0.0, 1.0);
  line.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 0.1)};
  return line;
}

TEST(ChangeDetector, ARatioLargerThanNumbersIsAnAlarmOnce) {
  // Five readings 0.9 s high: S of the offset upwards is 5 (0.5 * 0.9 - 0.125) = 1.6, since reading 0; that of the doubled
  // spread has l = -log 1.5 + 0.9^2 (1 - 1 / 2.25) / 2 = -0.18 each and stays at 0. The sixth is 1e4 s high: e^l is
  // infinite for the offset, l = 5000, and for the spread, l = 1e8 / 2 * 5 / 9 = 2.8e7, whose beginning is told.
  ChangeDetector detector(line_reference(), seldom());
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(detector.add(1.0, 1.09));
  const auto alarm = detector.add(1.0, 1001.0);
  ASSERT_TRUE(alarm);
  EXPECT_EQ(alarm->reading, 6);
  EXPECT_EQ(alarm->since, 5);
  for (const double value : detector.state()) EXPECT_TRUE(std::isfinite(value));
  Random random(seed_from("ratio once"));
  int raised = 0, named = 0;
  for (int i = 0; i < 1300; ++i) {
    const auto next = detector.add(1.0, random.normal(1.0, 0.1));
    if (next) ++(next->named ? named : raised);
  }
  EXPECT_EQ(named, 1);
  EXPECT_EQ(raised, 0);
}

TEST(ChangeDetector, PlacesAndNamesAStepOfAHundredStandardDeviations) {
  // 4 m is 100 s at f = 2 m and 1600 s at 0.5 m. Before the change S of the doubled spread is seldom long above 0.
  for (std::uint64_t repeat = 0; repeat < 20; ++repeat) {
    ChangeDetector detector(pairs_reference(), seldom());
    Random random(seed_from("hundred", {repeat}));
    std::optional<ChangeAlarm> raised;
    const auto named = first_named(1000, [&](int i) {
      const double d = random.uniform(0.5, 4.0);
      const auto alarm = detector.add(d, read(random, d, i < 500 ? 0.0 : 4.0));
      if (alarm && !alarm->named) raised = alarm;
      return alarm;
    });
    ASSERT_TRUE(raised && named && named->named);
    EXPECT_EQ(raised->reading, 501);
    EXPECT_NEAR(static_cast<double>(named->since), 500.0, 60.0);
    EXPECT_EQ(named->kind, ChangeKind::window);
    EXPECT_NEAR(named->size, 4.0, 4.0 * named->std_dev);
  }
}

TEST(ChangeDetector, PassesOverWhatCannotBeCounted) {
  // 1e308 m is infinitely many s; times g = sin(0) = 0 of the encoder that is no number.
  ChangeOptions options;
  options.bearings = true;
  ChangeDetector detector(line_reference(), options), plain(line_reference(), options);
  Random random(seed_from("not counted"));
  for (int i = 0; i < 2; ++i) {
    for (const double wild : {1e308, 1e200}) {
      EXPECT_FALSE(detector.add(1.0, wild, 0.0));
      EXPECT_FALSE(detector.add(wild, 1.0, 0.0));
    }
    EXPECT_EQ(detector.state(), plain.state());
    const auto alarm = first_named(1000, [&](int) {
      const double bearing = random.uniform(-3.14, 3.14), y = random.normal(1.3, 0.1);
      plain.add(1.0, y, bearing);
      const auto next = detector.add(1.0, y, bearing);
      detector.add(1.0, 1e308, 0.0);  // while a change is being named, too
      return next;
    });
    ASSERT_TRUE(alarm && alarm->named);
    EXPECT_TRUE(std::isfinite(alarm->size) && std::isfinite(alarm->probability));
  }
}

/// Alarms among 400 000 readings without a change, at distances that `distance` draws; N = 1000.
int alarms_without_change(bool bearings, double (*distance)(Random&)) {
  ChangeOptions options;
  options.run_length = 1000.0;
  options.naming = 10;  // no alarm is raised meanwhile
  options.bearings = bearings;
  ChangeDetector detector(pairs_reference(), options);
  Random random(seed_from("run length", {bearings}));
  int alarms = 0;
  for (int i = 0; i < 400000; ++i) {
    const double d = distance(random);
    const auto alarm = detector.add(d, read(random, d), random.uniform(-3.14, 3.14));
    alarms += alarm && !alarm->named;
  }
  return alarms;
}

TEST(ChangeDetector, RunLengthIsAtLeastAsStatedWhateverTheDistances) {
  // 400 stated; a Poisson number of alarms has a deviation of 20. Fewer by the excess of R over N, most where one reading
  // says much (near the sensor, where it is precise): down to a third asked.
  using Draw = double (*)(Random&);
  const Draw draws[] = {
      [](Random& random) { return random.uniform(0.5, 4.0); },
      [](Random&) { return 0.5; },
      [](Random&) { return 0.7; },
      [](Random&) { return 4.0; },
      [](Random& random) { return random.uniform(0.0, 1.0) < 0.1 ? 0.5 : 3.0; },
  };
  for (const bool bearings : {false, true})
    for (const Draw draw : draws) {
      const int alarms = alarms_without_change(bearings, draw);
      EXPECT_LT(alarms, 400 + 4 * 20) << bearings;
      EXPECT_GT(alarms, 133) << bearings;
    }
}

TEST(ChangeDetector, NamesWhatChangedWithItsSize) {
  struct Case {
    ChangeKind kind;
    double offset, scale, disparity, spread, size;
  };
  for (const Case& c : {Case{ChangeKind::window, 0.02, 1.0, 0.0, 1.0, 0.02},
                        Case{ChangeKind::baseline, 0.0, 1.03, 0.0, 1.0, 0.03},
                        Case{ChangeKind::pointing, 0.0, 1.0, 0.01, 1.0, 0.01},
                        Case{ChangeKind::noise, 0.0, 1.0, 0.0, 2.0, std::log(2.0)},
                        Case{ChangeKind::window, -0.02, 1.0, 0.0, 1.0, -0.02},
                        Case{ChangeKind::noise, 0.0, 1.0, 0.0, 0.5, -std::log(2.0)}}) {
    int named = 0, covered = 0, since = 0, found = 0;
    for (std::uint64_t repeat = 0; repeat < 60; ++repeat) {
      ChangeDetector detector(pairs_reference());
      Random random(seed_from("change", {repeat}));
      for (int i = 0; i < 1000; ++i) {
        const bool after = i >= 500;
        const double d = random.uniform(0.5, 4.0);
        const double y = after ? read(random, d, c.offset, c.scale, c.disparity, c.spread) : read(random, d);
        const auto alarm = detector.add(d, y);
        if (!alarm || !alarm->named) continue;
        ++found;
        named += alarm->kind == c.kind;
        covered += alarm->kind == c.kind && std::abs(alarm->size - c.size) < 3.0 * alarm->std_dev;
        since += std::abs(alarm->since - 500) < 60;
        break;
      }
    }
    EXPECT_EQ(found, 60) << to_string(c.kind);
    // Neighbouring directions are alike, hence not all: 85 % asked.
    EXPECT_GT(named, 51) << to_string(c.kind) << " " << c.size;
    EXPECT_GT(covered, 0.85 * named) << to_string(c.kind);
    EXPECT_GT(since, 48) << to_string(c.kind);
  }
}

TEST(ChangeDetector, SeesTheEncoderByItsBearing) {
  ChangeOptions options;
  options.bearings = true;
  ChangeDetector detector(pairs_reference(), options);
  Random random(seed_from("encoder"));
  const auto alarm = first_named(2000, [&](int i) {
    const double d = random.uniform(0.5, 4.0), bearing = random.uniform(-3.14, 3.14);
    return detector.add(d, read(random, d, i < 300 ? 0.0 : 0.02 * std::sin(bearing)), bearing);
  });
  ASSERT_TRUE(alarm);
  EXPECT_EQ(alarm->kind, ChangeKind::encoder);
  EXPECT_GT(alarm->reading, 300);
  EXPECT_NEAR(alarm->size, 0.02, 4.0 * alarm->std_dev);
  ASSERT_TRUE(alarm->phase_rad && alarm->phase_rad->std_dev);
  EXPECT_NEAR(alarm->phase_rad->value, 1.5708,
              4.0 * *alarm->phase_rad->std_dev);  // sin = cos(bearing - pi / 2)
}

/// Mean squares of (told - true) / standard deviation over streams that all change by 2 cm, 3 %, 0.01 /m, or 4 cm once a
/// turn at a phase of 2.9 rad, after 100 readings. `unsure`: the reference's curve is off by its covariance.
struct Told {
  int named = 0;
  double size = 0.0, phase = 0.0;
};
Told told_of(ChangeKind kind, bool unsure, std::uint64_t streams) {
  Eigen::Matrix3d L;  // of the curve from 300 pairs or so, in m^(1 - i)
  L << 2.2e-3, 0.0, 0.0, -4.9e-3, 1.1e-3, 0.0, 1.9e-3, -1.1e-3, 3.7e-4;
  const double sizes[] = {0.02, 0.03, 0.01, 0.04}, size = sizes[static_cast<int>(kind)];
  const auto changed = [&](double of) { return of == static_cast<double>(kind) ? size : 0.0; };
  ChangeOptions options;
  options.bearings = kind == ChangeKind::encoder;
  Told told;
  for (std::uint64_t stream = 0; stream < streams; ++stream) {
    Random random(seed_from("told", {stream, static_cast<std::uint64_t>(kind)}));
    Calibration reference = pairs_reference();
    if (unsure) {
      reference.alpha_covariance = L * L.transpose();
      reference.alpha += L * Eigen::Vector3d(random.normal(), random.normal(), random.normal());
    }
    ChangeDetector detector(reference, options);
    const auto alarm = first_named(3000, [&](int i) {
      const double d = random.uniform(0.5, 4.0), bearing = random.uniform(-3.14159, 3.14159),
                   turn = changed(3.0) * std::cos(bearing - 2.9);
      return detector.add(
          d,
          i < 100 ? read(random, d) : read(random, d, changed(0.0) + turn, 1.0 + changed(1.0), changed(2.0)),
          bearing);
    });
    if (!alarm || alarm->kind != kind || alarm->reading <= 100) continue;
    ++told.named;
    told.size += std::pow((alarm->size - size) / alarm->std_dev, 2);
    EXPECT_EQ(alarm->phase_rad.has_value(), kind == ChangeKind::encoder);  // other kinds have none
    if (!alarm->phase_rad) continue;
    const double off = std::remainder(alarm->phase_rad->value - 2.9, 6.283185307179586);
    told.phase += std::pow(off / alarm->phase_rad->std_dev.value_or(0.0), 2);
  }
  return told;
}

TEST(ChangeDetector, StandardDeviationsAreThoseSampledOverStreams) {
  // 300 streams each, of which a few alarm before the change: the mean square of n standard normals has the deviation
  // sqrt(2 / n), 4 of which are allowed.
  for (const bool unsure : {false, true})
    for (const ChangeKind kind :
         {ChangeKind::window, ChangeKind::baseline, ChangeKind::pointing, ChangeKind::encoder}) {
      const Told told = told_of(kind, unsure, 300);
      ASSERT_GE(told.named, 270) << to_string(kind);
      EXPECT_NEAR(told.size / told.named, 1.0, 4.0 * std::sqrt(2.0 / told.named))
          << to_string(kind) << unsure;
      if (kind == ChangeKind::encoder) {
        EXPECT_NEAR(told.phase / told.named, 1.0, 4.0 * std::sqrt(2.0 / told.named)) << unsure;
      }
    }
}

TEST(ChangeDetector, AnEccentricityNeedsBearingsThatDiffer) {
  // Seen under one bearing alone it is an offset.
  ChangeOptions options;
  options.bearings = true;
  ChangeDetector detector(pairs_reference(), options);
  Random random(seed_from("one bearing"));
  const auto alarm = first_named(2000, [&](int i) {
    const double d = random.uniform(0.5, 4.0);
    return detector.add(d, read(random, d, i < 300 ? 0.0 : 0.03), 0.7);
  });
  ASSERT_TRUE(alarm);
  EXPECT_EQ(alarm->kind, ChangeKind::window);
}

/// A reference whose noise is contaminated: 3 % of the readings spread 15-fold.
Calibration contaminated_reference() {
  Calibration c = pairs_reference();
  c.noise_shapes["range"] = {"contaminated", {{"outlier_share", 0.03}, {"outlier_scale", 15.0}}, {}};
  return c;
}

double read_contaminated(Random& random, double d, double share, double offset = 0.0) {
  return read(random, d, offset, 1.0, 0.0, random.uniform(0.0, 1.0) < share ? 15.0 : 1.0);
}

TEST(ChangeDetector, OutliersOfTheReferenceRaiseNoMoreAlarmsThanStated) {
  // 200 000 readings at N = 1000: 200 alarms at most, binomial + 4 sqrt(200). Of Gaussian noise every outlier would be one.
  ChangeOptions options;
  options.run_length = 1000.0;
  options.naming = 10;
  ChangeDetector detector(contaminated_reference(), options);
  Random random(seed_from("outliers known"));
  int alarms = 0;
  for (int i = 0; i < 200000; ++i) {
    const double d = random.uniform(0.5, 4.0);
    const auto alarm = detector.add(d, read_contaminated(random, d, 0.03));
    alarms += alarm && !alarm->named;
  }
  EXPECT_LT(alarms, 257);
  EXPECT_GT(alarms, 60);
}

TEST(ChangeDetector, NamesAShareOfOutliersThatGrows) {
  // From none to 5 % late echoes of 0.3 m beside Gaussian noise, from 3 to 15 % beside a contaminated one, and a window of
  // 3 cm beside that: found within 1500 readings, named in 18 of 20 at least, sizes within 4 deviations in 18.
  struct Case {
    Calibration reference;
    double before, after, offset;
    ChangeKind kind;
    double size;
  };
  for (const Case& c : {Case{pairs_reference(), 0.0, 0.05, 0.0, ChangeKind::outliers, 0.05},
                        Case{contaminated_reference(), 0.03, 0.15, 0.0, ChangeKind::outliers, 0.15},
                        Case{contaminated_reference(), 0.03, 0.03, 0.03, ChangeKind::window, 0.03}}) {
    int named = 0, covered = 0;
    for (std::uint64_t repeat = 0; repeat < 20; ++repeat) {
      ChangeDetector detector(c.reference);
      Random random(seed_from("share grows", {repeat}));
      const auto alarm = first_named(2500, [&](int i) {
        const double d = random.uniform(0.5, 4.0);
        const bool changed = i >= 500;
        return detector.add(
            d, read_contaminated(random, d, changed ? c.after : c.before, changed ? c.offset : 0.0));
      });
      ASSERT_TRUE(alarm && alarm->named) << to_string(c.kind);
      named += alarm->kind == c.kind && alarm->reading > 500;
      // of a share by another shape of outliers the size is that of what lies beyond the body
      covered += std::abs(alarm->size - c.size) < 4.0 * alarm->std_dev;
    }
    EXPECT_GE(named, 18) << to_string(c.kind) << ' ' << c.size;
    EXPECT_GE(covered, 18) << to_string(c.kind) << ' ' << c.size;
  }
}

TEST(ChangeDetector, StateGoesOnAndBadInputIsRefused) {
  ChangeDetector a(pairs_reference()), b(pairs_reference()), whole(pairs_reference());
  Random random(seed_from("state"));
  for (int i = 0; i < 400; ++i) {
    const double d = random.uniform(0.5, 4.0), y = read(random, d);
    whole.add(d, y);
    (i < 200 ? a : b).add(d, y);
    if (i == 199) b.restore(a.state());
  }
  EXPECT_EQ(b.state(), whole.state());
  // of version 0.1.0, four numbers a chart: the value, two sums, since when
  std::vector<double> first(4 + 4 * 8, 0.0);
  first[0] = first[4 + 3] = 400.0;
  first[4] = 2.0;
  b.restore(first);
  EXPECT_EQ(b.readings(), 400);
  EXPECT_NEAR(b.state()[5], std::exp(2.0), 1e-12);
  EXPECT_FALSE(a.add(1.0, std::nan("")));
  EXPECT_FALSE(a.add(1.0, -1.0));
  EXPECT_THROW(a.restore({1.0}), InputError);
  // R, S, sum z^2, a sum of scores and a count of their kind; naming by 300 readings at most
  const std::vector<double> sound = a.state();
  for (const auto& [place, value] :
       std::vector<std::pair<std::size_t, double>>{{5, std::nan("")},
                                                   {5, -1.0},
                                                   {6, std::nan("")},
                                                   {6, -1.0},
                                                   {4, -1.0},
                                                   {4, HUGE_VAL},
                                                   {5, HUGE_VAL},
                                                   {sound.size() - 1, std::nan("")},
                                                   {7, -1.0},
                                                   {2, 301.0}}) {
    std::vector<double> broken = sound;
    broken[place] = value;
    EXPECT_THROW(a.restore(broken), InputError) << place << ' ' << value;
  }
  first[4] = std::nan("");
  EXPECT_THROW(b.restore(first), InputError);
  a.restore(sound);
  EXPECT_EQ(a.state(), sound);
  EXPECT_THROW(ChangeDetector(Calibration{}), InputError);
  ChangeOptions bad;
  bad.run_length = 1.0;
  EXPECT_THROW(ChangeDetector(pairs_reference(), bad), InputError);
}

}  // namespace
}  // namespace rangecal
