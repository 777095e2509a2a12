// SPDX-License-Identifier: BSD-3-Clause
// Readings at known distances that hang together within their batches: an error of the batch, a filter in the driver.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "diagnosis/rows.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "solvers/diagnosis/made_recordings.hpp"

namespace rangecal {
namespace {

/// 25 batches of 40 readings, f = 0.05 + 0.9 d + 0.05 d^2, s = 0.005 f^2; `shared_m` is added to all of a batch, `rho`
/// goes from reading to reading.
Recording batches(double shared_m, double rho, const std::string& name, std::uint64_t seed) {
  Random random(seed_from(name, {seed}));
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  Pairs& p = recording.pairs;
  for (int batch = 0; batch < 25; ++batch) {
    const double d = 0.5 + 4.0 * batch / 24.0, f = 0.05 + d * (0.9 + 0.05 * d);
    const double shared = random.normal(0.0, shared_m);
    double e = random.normal();
    for (int i = 0; i < 40; ++i) {
      if (i > 0) e = rho * e + std::sqrt(1.0 - rho * rho) * random.normal();
      p.true_m.push_back(d);
      p.reading_m.push_back(f + shared + 0.005 * f * f * e);
      p.batch.push_back(batch);
      p.time_s.push_back(0.2 * static_cast<double>(p.time_s.size()));
      p.row.push_back(static_cast<int>(p.row.size()) + 2);
    }
    p.batch_labels.push_back(std::to_string(batch));
  }
  return recording;
}

TEST(PairsDependence, AnErrorOfTheBatchIsNoPhysicsOfTheRange) {
  int named = 0, held = 0;
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    const Diagnosis d = testing::verdict_of(batches(0.006, 0.0, "PairsDependence.Shared", seed));
    if (d.verdict != Verdict::explained) continue;
    EXPECT_EQ(d.final_effects, std::vector<std::string>{"cell_effect"}) << seed << ": " << d.sentence;
    ++named;
    for (const EffectEstimate& e : d.explanations.at(0).parameters)
      held += e.name == "cell_effect.sigma_m" && e.low95 < 0.006 && e.high95 > 0.006;
  }
  // Of 20 recordings by another generator all were named and held 6 mm; one of these follows a free curve of 25 points.
  EXPECT_GE(named, 7);
  EXPECT_GE(held, named - 2);  // three of eight outside: once in 170 times
}

TEST(PairsDependence, AFilterOfTheDriverIsFound) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    const Diagnosis d = testing::verdict_of(batches(0.0, 0.85, "PairsDependence.Filter", seed));
    EXPECT_EQ(d.final_effects, std::vector<std::string>{"autocorrelated_noise"})
        << seed << ": " << d.sentence;
    for (const EffectEstimate& e : d.explanations.at(0).parameters)
      EXPECT_EQ(e.name, "autocorrelated_noise.rho");  // pairs have no bearings to correlate
  }
}

TEST(PairsDependence, CleanBatchesAreClean) {
  int alarms = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed)
    alarms +=
        testing::verdict_of(batches(0.0, 0.0, "PairsDependence.Clean", seed)).verdict != Verdict::no_mismatch;
  EXPECT_LE(alarms, 3);  // of 20 at 2 %: four or more once in 1500 times
}

TEST(PairsDependence, CellsAreTheReadingsOfABatchAtOneDistance) {
  Recording recording = batches(0.0, 0.0, "PairsDependence.Cells", 0);
  const auto cells = [&] { return diagnosis::make_rows({&recording, 1}).cell_count; };
  EXPECT_EQ(cells(), 25);
  recording.pairs.batch.assign(recording.pairs.size(), 3);  // one batch at 25 distances
  EXPECT_EQ(cells(), 25);
  recording.pairs.batch[7] = -1;  // in no batch: alone
  EXPECT_EQ(cells(), 26);
  recording.pairs.batch.clear();
  EXPECT_EQ(cells(), 25);
  std::swap(recording.pairs.true_m[0],
            recording.pairs.true_m[999]);  // cells need not be together in the file
  std::swap(recording.pairs.reading_m[0], recording.pairs.reading_m[999]);
  const diagnosis::Rows rows = diagnosis::make_rows({&recording, 1});
  EXPECT_EQ(rows.cell_count, 25);
  const std::vector<std::size_t> order = diagnosis::row_order(recording);
  for (std::size_t row = 0; row < order.size(); ++row)
    EXPECT_EQ(rows.file_row[row], recording.pairs.row[order[row]]);
  EXPECT_EQ(rows.problem.readings, 1000.0);
}

}  // namespace
}  // namespace rangecal
