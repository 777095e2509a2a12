// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <glog/logging.h>

#include <cstddef>
#include <limits>
#include <string>
#include <utility>

#include "rangecal/core/noise.hpp"
#include "rangecal/core/outcome.hpp"

namespace rangecal {

/// What keeps a step short, by name: "lambda" is added to the diagonal of the Hessian, "length" is the share of the step that
/// was taken, "radius" that of a trust region.
struct Damping {
  const char* name = nullptr;  ///< none: the solver damps nothing
  double value = 0.0;
};

/// A number that a solver does not have.
inline constexpr double not_known = std::numeric_limits<double>::quiet_NaN();

/// The lines by which a solve is followed: one for each iteration, one for its end (docs/diagnosis.md, "How to follow a solve").
/// They go to glog, and only where the host of this library has initialised glog and set FLAGS_v, or the level of this file alone
/// (--vmodule=solver_log=2), to 1 or more; else a solve pays for comparing two integers. A solve inside another one on the same thread is an inner one: its lines are
/// indented, its end is told at level 2, also where the outer one tells nothing itself. A line says what the solver knows: nothing is worked out for it.
class SolverLog {
 public:
  explicit SolverLog(const char* solver) : solver_(solver), on_(VLOG_IS_ON(1) && enter()) {}
  ~SolverLog() {
    if (on_) leave();
  }
  SolverLog(const SolverLog&) = delete;
  SolverLog& operator=(const SolverLog&) = delete;

  bool on() const { return on_; }
  bool iterations_on() const { return on_ && VLOG_IS_ON(2); }

  /// What is solved, behind the solver's name: "order 2, noise f2".
  void of(std::string what) { of_ = std::move(what); }

  /// Level 2. `cost` after the step [nats]; `step`: length of the step taken, 0 if refused, and `gradient`: Newton's decrement
  /// sqrt(g^T H^-1 g), both in standard deviations of the estimate.
  void iteration(int number, double cost, double step, double gradient, Damping damping = {},
                 const char* file = __builtin_FILE(), int line = __builtin_LINE()) const {
    if (iterations_on()) write_iteration(number, cost, step, gradient, damping, file, line);
  }
  /// Level 1, of inner solves 2. `iterations` below 0: not counted.
  void end(int iterations, double cost, double gradient, Outcome outcome, const std::string& reason = {},
           const char* file = __builtin_FILE(), int line = __builtin_LINE()) const {
    if (on_) write_end(iterations, cost, gradient, to_string(outcome), reason, file, line);
  }
  /// Of a solve that has no outcome: why it ended.
  void end(int iterations, double cost, const char* why, const char* file = __builtin_FILE(),
           int line = __builtin_LINE()) const {
    if (on_) write_end(iterations, cost, not_known, "ended", why, file, line);
  }

 private:
  static bool enter();  ///< false where the host has not initialised glog
  static void leave();
  void write_iteration(int number, double cost, double step, double gradient, Damping damping,
                       const char* file, int line) const;
  void write_end(int iterations, double cost, double gradient, const char* how, const std::string& reason,
                 const char* file, int line) const;

  const char* solver_;
  const bool on_;
  std::string of_;
};

/// "order 2, noise f2".
std::string curve_in_words(std::ptrdiff_t coefficients, NoiseLaw law);

/// What a solver of a curve of so many coefficients ends with, its end told: solve(log). `cost`: its NLL [nats].
template <typename Fit, typename Solve>
Fit followed(const char* solver, std::ptrdiff_t coefficients, NoiseLaw law, double Fit::*cost,
             const Solve& solve, const char* file = __builtin_FILE(), int line = __builtin_LINE()) {
  SolverLog log(solver);
  if (log.on()) log.of(curve_in_words(coefficients, law));
  Fit fit = solve(log);
  log.end(fit.iterations, fit.*cost, fit.gradient_norm, fit.outcome, fit.reason, file, line);
  return fit;
}

/// True where level 1 is asked for.
inline bool tells_outcomes() { return VLOG_IS_ON(1) && google::IsGoogleLoggingInitialized(); }
/// A line of level 1 that is no solver's; to be called where tells_outcomes().
void tell(const std::string& text, const char* file = __builtin_FILE(), int line = __builtin_LINE());

/// Ceres warns through glog of every matrix that it cannot factor, whatever its own logging is set to, and
/// glog writes to stderr until its host says where to. A library does not print: unless the host has set glog
/// up, nothing is written.
inline void silence_ceres() {
  static const bool once = [] {
    if (!google::IsGoogleLoggingInitialized()) FLAGS_minloglevel = google::GLOG_FATAL;
    return true;
  }();
  static_cast<void>(once);
}

}  // namespace rangecal
