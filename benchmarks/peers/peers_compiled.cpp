// SPDX-License-Identifier: BSD-3-Clause
// The compiled side of the comparison with other programs (benchmarks/peers/README.md): makes the data, solves with rangecal,
// Ceres and NLopt, and scores everybody's answers by the same likelihood and the same bound.
//
//   peers_compiled make  pairs|joint SIZE SETS FOLDER
//   peers_compiled solve pairs|joint SIZE SETS FOLDER METHOD CAP    prints per set: seconds, megabytes
//   peers_compiled score pairs|joint SIZE SETS FOLDER METHOD...     prints per method: what `Score` holds
#include <fmt/core.h>
#include <malloc.h>
#include <sched.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <string>

#include "../lane.hpp"
#include "../pairs_programs.hpp"
#include "../plain_ceres.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/covariance/cramer_rao.hpp"
#include "rangecal/solvers/joint_ml/joint_ceres.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace {

using namespace rangecal;
using namespace rangecal::benchmark;

struct Job {
  bool pairs = true;
  int size = 0, sets = 0;  // N readings or K stops
  std::string folder;

  std::string file(const std::string& name, int set) const {
    return fmt::format("{}/{}-{}.bin", folder, name, set);
  }
  int landmarks() const { return size <= 20 ? 5 : 50; }
  JointProblem lane(int set, JointState* truth = nullptr) const {
    return make_lane(size, landmarks(), size <= 20 ? 5 : 10, static_cast<std::uint64_t>(set) + 1, truth);
  }
  /// A solve counts as at the optimum within this much of the best NLL [nats].
  double at_optimum() const { return pairs ? 1e-6 : 1e-3; }
};

void write(const std::string& path, const std::vector<double>& values) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(values.data()),
             static_cast<std::streamsize>(values.size() * sizeof(double)));
}

std::vector<double> read(const std::string& path) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) return {};
  std::vector<double> values(static_cast<std::size_t>(file.tellg()) / sizeof(double));
  file.seekg(0);
  file.read(reinterpret_cast<char*>(values.data()),
            static_cast<std::streamsize>(values.size() * sizeof(double)));
  return values;
}

/// (alpha, log sigma_e, log sigma_theta, landmarks, stops): the order of everybody's answers.
std::vector<double> flat(const JointState& state) {
  std::vector<double> x(state.alpha.data(), state.alpha.data() + state.alpha.size());
  x.push_back(std::log(state.noise.parameters[0]));
  x.push_back(std::log(state.sigma_theta_rad));
  for (const Eigen::Vector2d& m : state.landmarks) x.insert(x.end(), {m.x(), m.y()});
  for (const Pose2& p : state.stops) x.insert(x.end(), {p.x_m, p.y_m});
  return x;
}

JointState unflat(const std::vector<double>& x, JointState state) {
  if (x.size() != flat(state).size()) return {};
  state.alpha = Eigen::Vector3d(x[0], x[1], x[2]);
  state.noise.parameters[0] = std::exp(x[3]);
  state.sigma_theta_rad = std::exp(x[4]);
  std::size_t at = 5;
  for (Eigen::Vector2d& m : state.landmarks) {
    m = {x[at], x[at + 1]};
    at += 2;
  }
  for (Pose2& p : state.stops) {
    p.x_m = x[at];
    p.y_m = x[at + 1];
    at += 2;
  }
  return state;
}

/// pairs: d[N], y[N]. joint: (K, cells), then stop, landmark, range, bearing, radius per cell as columns, commanded x and y per
/// stop, sigma_s, and the start of all methods.
void make(const Job& job) {
  for (int set = 0; set < job.sets; ++set) {
    std::vector<double> values;
    if (job.pairs) {
      const PairsProblem problem = simulate_pairs(job.size, static_cast<std::uint64_t>(set));
      values = problem.true_m;
      values.insert(values.end(), problem.mean_m.begin(), problem.mean_m.end());
    } else {
      const JointProblem p = job.lane(set);
      const Cells& c = p.cells;
      values = {static_cast<double>(job.size), static_cast<double>(job.landmarks()),
                static_cast<double>(c.size())};
      for (const auto* column : {&c.stop, &c.landmark})
        values.insert(values.end(), column->begin(), column->end());
      for (const auto* column : {&c.range_mean, &c.bearing_mean, &c.radius_m})
        values.insert(values.end(), column->begin(), column->end());
      for (const StopPrior& stop : p.stops) values.push_back(stop.commanded.x_m);
      for (const StopPrior& stop : p.stops) values.push_back(stop.commanded.y_m);
      values.push_back(p.stops[0].sigma_xy_m);
      const std::vector<double> start = flat(position_seed(p, 2, NoiseLaw::f));
      values.insert(values.end(), start.begin(), start.end());
    }
    write(job.file("data", set), values);
  }
}

double status_megabytes(const char* field) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with(field)) return std::atof(line.c_str() + std::string(field).size()) / 1024.0;
  return 0.0;
}

/// Plain Ceres at its best: floors far below the spreads or near them, each at the loosest tolerance that ends within
/// at_optimum() of `best`, the faster of the two. Returns the option to measure.
PlainOptions tuned_ceres(const Job& job, const JointProblem& problem, const JointState& seed, double best) {
  PlainOptions fastest;
  double fastest_seconds = std::numeric_limits<double>::infinity();
  for (const double ratio : {0.3, 1e-3}) {
    // From 10^4 stops on floors near the spreads are the faster by far; the search costs minutes there.
    if (ratio < 0.1 && job.size >= 10000 && std::isfinite(fastest_seconds)) continue;
    for (double tolerance = job.size > 10000 ? 1e-8 : 1e-6; tolerance > 1e-13; tolerance *= 0.1) {
      const PlainOptions options{ratio, tolerance};
      const auto begin = std::chrono::steady_clock::now();
      const double nll = joint_nll(problem, solve_plain_ceres(problem, seed, options));
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
      if (!(nll < best + job.at_optimum())) continue;
      if (seconds < fastest_seconds) {
        fastest_seconds = seconds;
        fastest = options;
      }
      break;
    }
  }
  return fastest;
}

void solve(const Job& job, const std::string& method, double cap) {
  if (method == "rangecal_1_thread") {
    cpu_set_t one;
    CPU_ZERO(&one);
    CPU_SET(static_cast<std::size_t>(sched_getcpu()), &one);
    sched_setaffinity(0, sizeof one, &one);
  }
  double spent = 0.0;
  PlainOptions plain;
  for (int set = 0; set < job.sets && spent < cap; ++set) {
    std::function<std::vector<double>()> call;
    PairsProblem pairs;
    JointProblem joint;
    JointState seed;
    if (job.pairs) {
      pairs = simulate_pairs(job.size, static_cast<std::uint64_t>(set));
      const auto numbers = [](const PairsPoint& p) {
        return std::vector<double>{p.alpha[0], p.alpha[1], p.alpha[2], std::log(p.sigma)};
      };
      if (method.starts_with("rangecal"))
        call = [&pairs, numbers] {
          const Calibration fit = full_pairs(pairs).calibration;
          return numbers({fit.alpha, fit.noise.parameters[0]});
        };
      else if (method == "ceres")
        call = [&pairs, numbers] { return numbers(pairs_by_plain_ceres(pairs)); };
      else
        call = [&pairs, numbers] { return numbers(pairs_by_nlopt(pairs)); };
    } else {
      joint = job.lane(set);
      seed = position_seed(joint, 2, NoiseLaw::f);
      if (method.starts_with("rangecal"))
        call = [&] { return flat(solve_joint_block(joint, seed).state); };
      else
        call = [&] { return flat(solve_plain_ceres(joint, seed, plain)); };
      if (method == "ceres") plain = tuned_ceres(job, joint, seed, solve_joint_block(joint, seed).joint_nll);
    }
    malloc_trim(0);
    std::ofstream("/proc/self/clear_refs") << "5";  // the peak starts anew here
    const double before = status_megabytes("VmRSS:");
    std::vector<double> answer;
    const double seconds = seconds_of([&] { answer = call(); }, 0.05);
    const double megabytes = status_megabytes("VmHWM:") - before;
    spent += std::fmax(0.05, seconds);
    write(job.file(method, set), answer);
    fmt::print("{} {:.9f} {:.2f}\n", set, seconds, megabytes);
    std::fflush(stdout);
  }
}

/// Squared error of an answer and its bound: of f at the readings (pairs) [m^2], of the landmarks (joint) [m^2].
struct Judged {
  double nll = std::numeric_limits<double>::infinity(), square = 0.0;
};

struct Score {
  int sets = 0, answers = 0, at_optimum = 0;
  std::vector<double> above;
  double square = 0.0, bound = 0.0;
};

void score(const Job& job, const std::vector<std::string>& methods) {
  std::map<std::string, Score> scores;
  for (int set = 0; set < job.sets; ++set) {
    std::function<Judged(const std::vector<double>&)> judge;
    PairsProblem pairs;
    JointProblem joint;
    JointState truth;
    Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();
    double bound = 0.0;
    if (job.pairs) {
      pairs = simulate_pairs(job.size, static_cast<std::uint64_t>(set));
      for (const double d : pairs.true_m) {
        const Eigen::Vector3d row(1.0, d, d * d);
        moments += row * row.transpose() / job.size;
      }
      const PairsPoint at;
      const PairsDerivatives information = pairs_derivatives(
          pairs, at.alpha, Noise{NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, at.sigma)});
      bound = (information.information.inverse().topLeftCorner<3, 3>() * moments).trace();
      judge = [&](const std::vector<double>& x) {
        if (x.size() != 4) return Judged{};
        const Eigen::Vector3d alpha(x[0], x[1], x[2]), error = alpha - PairsPoint{}.alpha;
        return Judged{pairs_nll_at(pairs, {alpha, std::exp(x[3])}), error.dot(moments * error)};
      };
    } else {
      joint = job.lane(set, &truth);
      const auto covariance = cramer_rao_bound(joint, truth);
      if (covariance) bound = covariance->diagonal().segment(3, 2 * job.landmarks()).sum();
      judge = [&](const std::vector<double>& x) {
        const JointState state = unflat(x, truth);
        if (state.alpha.size() == 0) return Judged{};
        Judged out{joint_nll(joint, state), 0.0};
        for (int l = 0; l < job.landmarks(); ++l)
          out.square += (state.landmarks[l] - truth.landmarks[l]).squaredNorm();
        return out;
      };
    }
    std::map<std::string, Judged> judged;
    double best = std::numeric_limits<double>::infinity();
    for (const std::string& method : methods) {
      const std::vector<double> answer = read(job.file(method, set));
      if (answer.empty()) continue;  // not run
      judged[method] = judge(answer);
      if (std::isfinite(judged[method].nll)) best = std::fmin(best, judged[method].nll);
    }
    for (const auto& [method, value] : judged) {
      Score& s = scores[method];
      ++s.sets;
      if (!(value.nll < best + 100.0)) continue;  // no answer, or one of another problem
      ++s.answers;
      s.at_optimum += value.nll <= best + job.at_optimum();
      s.above.push_back(value.nll - best);
      s.square += value.square;
      s.bound += bound;
    }
  }
  for (const auto& [method, s] : scores)
    fmt::print("{} {} {} {} {:.3e} {:.4f}\n", method, s.sets, s.answers, s.at_optimum, upper_median(s.above),
               std::sqrt(s.square / s.bound));
}

}  // namespace

int main(int count, char** arguments) {
  if (count < 6) return 2;
  const std::string task = arguments[1], kind = arguments[2];
  Job job;
  job.pairs = kind == "pairs";
  job.size = std::atoi(arguments[3]);
  job.sets = std::atoi(arguments[4]);
  job.folder = arguments[5];
  if (task == "make") make(job);
  if (task == "solve" && count == 8) solve(job, arguments[6], std::atof(arguments[7]));
  if (task == "score") score(job, {arguments + 6, arguments + count});
  return 0;
}
