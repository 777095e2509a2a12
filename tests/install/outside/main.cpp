// SPDX-License-Identifier: BSD-3-Clause
// Calibrates a recording with the installed library. Prints its version and the distance behind a reading of 1.234 m.
#include <cmath>
#include <cstdio>
#include <exception>
#include <string>

#include <rangecal/core/recording_io.hpp>
#include <rangecal/core/version.hpp>
#include <rangecal/solvers/calibrate.hpp>
#include <rangecal/solvers/correction/correct.hpp>

int main(int count, char** arguments) try {
  if (count != 2) return 2;
  const rangecal::Recording recording = rangecal::load_recording(arguments[1]);
  rangecal::CalibrateOptions options;
  options.methods = {rangecal::Method::marginal};
  const rangecal::Calibration calibration = rangecal::calibrate({&recording, 1}, options)[0];
  if (calibration.outcome != rangecal::Outcome::converged) return 1;
  const rangecal::Correction correction = rangecal::correct(calibration, 1.234);
  const double distance_m = correction.least_squares[correction.best_least_squares].distance_m;
  std::printf("rangecal %s: 1.234 m reads from %.3f m\n", std::string(rangecal::version()).c_str(), distance_m);
  return std::abs(distance_m - 1.234) < 0.2 ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
