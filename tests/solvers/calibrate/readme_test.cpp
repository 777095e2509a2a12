// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <rangecal/core/recording_io.hpp>
#include <rangecal/solvers/calibrate.hpp>
#include <rangecal/solvers/correction/correct.hpp>

// The README's library call, as it stands there.
TEST(Readme, LibraryCall) {
  const rangecal::Recording recording =
      rangecal::load_recording(RANGECAL_SOURCE_DIR "/notebooks_data/field-layout");
  rangecal::CalibrateOptions options;
  options.methods = {rangecal::Method::marginal};
  const rangecal::Calibration calibration = rangecal::calibrate({&recording, 1}, options)[0];
  ASSERT_EQ(calibration.outcome, rangecal::Outcome::converged);
  const rangecal::Correction correction = rangecal::correct(calibration, 1.234);
  ASSERT_GE(correction.best_least_squares, 0);
  const double distance_m = correction.least_squares[correction.best_least_squares].distance_m;
  // f(1.2361) = 0.0525 + 0.8838 * 1.2361 + 0.0584 * 1.5279 = 1.2342 for the sensor that was simulated; the
  // curve is known to about 5 mm there.
  EXPECT_NEAR(distance_m, 1.236, 0.02);
}
