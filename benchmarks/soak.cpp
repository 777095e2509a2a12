// SPDX-License-Identifier: BSD-3-Clause
// soak SECONDS [DATA]: one process that calibrates, corrects, diagnoses, simulates, saves, loads, studies and
// tracks over and over, and says how much memory it holds. Exit code 1 where the last quarter holds 2 % more
// than the second.
#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/correction/correct.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"
#include "rangecal/solvers/statistics/median.hpp"
#include "rangecal/solvers/study/run.hpp"

namespace {

using namespace rangecal;
using Clock = std::chrono::steady_clock;

double megabytes() {
  long pages = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> pages >> resident;
  return static_cast<double>(resident) * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1e6;
}

struct Soak {
  std::string data, work;
  RecursiveCalibrator tracked;
  long rounds = 0;

  void round() {
    const Recording field = load_recording(data + "/field-layout");
    CalibrateOptions all;
    all.methods = {Method::closed_form, Method::approximate, Method::full, Method::marginal};
    const std::vector<Calibration> calibrations = calibrate({&field, 1}, all);
    save_calibrations(calibrations, work + "/cal.json");
    const Calibration best = load_calibration(work + "/cal.json");
    for (int i = 1; i < 200; ++i) correct(best, 0.02 * i);

    const auto seed = static_cast<std::uint64_t>(rounds);
    save_recording(simulate(load_scene(data + "/scenes/pairs-2016.yaml"), seed), work + "/pairs");
    const Recording pairs = load_recording(work + "/pairs");
    DiagnoseOptions quick;
    quick.unseen = quick.next_experiments = false;
    diagnose({&pairs, 1}, quick);

    Study study = load_study(data + "/studies/quick.yaml");
    study.repeats = 20;
    run_study(study, 2);

    Random random(seed_from("soak", {seed}));
    for (int i = 0; i < 1000000; ++i) {
      const double d = random.uniform(0.3, 4.0), f = 0.05 + 0.9 * d;
      tracked.add(d, random.normal(f, 0.01 * f * f));
    }
    tracked = RecursiveCalibrator::from_json(tracked.to_json(), "soak");
    tracked.full();
    ++rounds;
  }
};

}  // namespace

int main(int argc, char** argv) {
  const double wanted = argc > 1 ? std::atof(argv[1]) : 3600.0;
  std::string work = (std::filesystem::temp_directory_path() / "rangecal-soak-XXXXXX").string();
  if (!::mkdtemp(work.data())) return 2;
  Soak soak{argc > 2 ? argv[2] : "notebooks_data", work, RecursiveCalibrator{}};
  std::vector<double> held;
  const auto begin = Clock::now();
  double said = 0.0, now = 0.0;
  while (now < wanted) {
    soak.round();
    now = std::chrono::duration<double>(Clock::now() - begin).count();
    held.push_back(megabytes());
    if (now - said < wanted / 12.0) continue;
    said = now;
    fmt::print("{:6.0f} s {:6} rounds {:10} pairs tracked {:8.1f} MB\n", now, soak.rounds,
               soak.tracked.used(), held.back());
    std::fflush(stdout);
  }
  std::filesystem::remove_all(work);
  const std::size_t quarter = held.size() / 4;
  if (quarter == 0) return 0;
  const auto part = [&](std::size_t q) {
    return upper_median(
        {held.begin() + static_cast<long>(q * quarter), held.begin() + static_cast<long>((q + 1) * quarter)});
  };
  fmt::print("second quarter {:.1f} MB, last quarter {:.1f} MB\n", part(1), part(3));
  return part(3) > 1.02 * part(1) ? 1 : 0;
}
