// SPDX-License-Identifier: BSD-3-Clause
// Time and memory per solve of the joint likelihood: block solver, our Ceres path, and a plain Ceres program.
//
// usage: joint_speed [largest K = 100000] [solves at K = 20 = 200]
//
// Each method runs in a process of its own from the same seed; memory is the peak of that process less what it held
// before the solve. The plain program's tolerance is the loosest power of ten that ends within 1e-3 nats of the best; it
// is tried with floors far below the spreads, which any start can use, and near them, which is quicker where it works.
// From 1024 stops on the block solver uses all cores (taskset -c 0 for one); Ceres runs on one thread, its default.
#include <fmt/core.h>
#include <malloc.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <functional>
#include <limits>
#include <string>

#include "lane.hpp"
#include "plain_ceres.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/joint_ml/joint_ceres.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"

namespace {

using namespace rangecal;

struct Measured {
  double milliseconds = 0.0, megabytes = 0.0, nll = 0.0;
  int iterations = 0;
};

double resident_megabytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

using Solve = std::function<double(int& iterations)>;

/// Runs `solve` `repeats` times in a child process; the fastest tenth counts, others share the machine.
Measured in_child(const Solve& solve, int repeats) {
  int ends[2];
  if (pipe(ends) != 0) return {};
  std::fflush(stdout);
  const pid_t child = fork();
  if (child == 0) {
    Measured result;
    malloc_trim(0);
    const double before = resident_megabytes();
    std::vector<double> times;
    for (int i = 0; i < repeats; ++i) {
      const auto begin = std::chrono::steady_clock::now();
      result.nll = solve(result.iterations);
      times.push_back(
          std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count());
    }
    std::sort(times.begin(), times.end());
    result.milliseconds = times[times.size() / 10];
    result.megabytes = resident_megabytes() - before;
    const ssize_t written = write(ends[1], &result, sizeof result);
    _exit(written == sizeof result ? 0 : 1);
  }
  close(ends[1]);
  Measured result;
  if (read(ends[0], &result, sizeof result) != sizeof result)
    result.nll = std::numeric_limits<double>::quiet_NaN();
  close(ends[0]);
  int status = 0;
  waitpid(child, &status, 0);
  return result;
}

void run(int stops, int landmarks, int sight, int repeats) {
  const JointProblem problem = benchmark::make_lane(stops, landmarks, sight, 1);
  const JointState seed = position_seed(problem, 2, NoiseLaw::f);
  const Measured block = in_child(
      [&](int& iterations) {
        const JointFit fit = solve_joint_block(problem, seed);
        iterations = fit.iterations;
        return fit.joint_nll;
      },
      repeats);
  const Measured ours = in_child(
      [&](int& iterations) {
        const JointFit fit = solve_joint_ceres(problem, seed);
        iterations = fit.iterations;
        return fit.joint_nll;
      },
      std::max(1, repeats / 2));
  const auto plain_with = [&](double ratio, int times) {
    Measured plain;
    for (double tolerance = 1e-6; tolerance > 1e-16; tolerance *= 0.1) {
      plain = in_child(
          [&](int& iterations) {
            return joint_nll(problem,
                             benchmark::solve_plain_ceres(problem, seed, {ratio, tolerance}, &iterations));
          },
          1);
      if (!(plain.nll < block.nll + 1e-3)) continue;
      if (times == 1) break;
      return in_child(
          [&](int& iterations) {
            return joint_nll(problem,
                             benchmark::solve_plain_ceres(problem, seed, {ratio, tolerance}, &iterations));
          },
          times);
    }
    return plain;
  };
  const Measured plain = plain_with(1e-3, std::max(1, repeats / 2)),
                 tight = plain_with(0.3, std::max(1, repeats / 2));
  const auto print = [&](const char* name, const Measured& m, bool same = true) {
    const char* note = !same                      ? "  (another criterion)"
                       : m.nll < block.nll + 1e-3 ? ""
                                                  : "  (more than 1e-3 off)";
    fmt::print("{:7d} {:3d} {:7d}  {:<34} {:12.4f} {:5d} {:8.1f} {:10.1f} {:8.2f} {:16.6f}{}\n", stops,
               landmarks, static_cast<int>(problem.cells.size()), name, m.milliseconds, m.iterations,
               plain.milliseconds / m.milliseconds, m.megabytes, m.megabytes / plain.megabytes, m.nll, note);
  };
  print("block", block);
  print("ours, by Ceres", ours);
  print("plain Ceres", plain);
  print("plain Ceres, floors near spreads", tight);
  if (stops <= 1000) {
    const JointState full = solve_joint_block(problem, seed).state;
    print("marginal, after full",
          in_child(
              [&](int& iterations) {
                const MarginalFit fit = solve_marginal(problem, full);
                iterations = fit.iterations;
                return fit.joint_nll;
              },
              std::max(1, repeats / 10)),
          false);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int largest = argc > 1 ? std::atoi(argv[1]) : 100000, solves = argc > 2 ? std::atoi(argv[2]) : 200;
  fmt::print("{:>7} {:>3} {:>7}  {:<34} {:>12} {:>5} {:>8} {:>10} {:>8} {:>16}\n", "K", "L", "cells",
             "method", "ms / solve", "iter", "faster", "MB", "of plain", "NLL [nats]");
  run(20, 5, 5, solves);
  for (int stops : {1000, 10000, 100000})
    if (stops <= largest)
      run(stops, 50, 10, stops <= 1000 ? std::max(1, solves / 20) : stops <= 10000 ? 3 : 1);
  return 0;
}
