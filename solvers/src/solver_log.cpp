// SPDX-License-Identifier: BSD-3-Clause
#include "solver_log.hpp"

#include <fmt/core.h>

#include <cmath>

namespace rangecal {
namespace {

thread_local int solves_on_this_thread = 0;  // one inside the other

std::string shortly(double value) { return std::isnan(value) ? "-" : fmt::format("{:.1e}", value); }
std::string in_nats(double cost) { return std::isnan(cost) ? "-" : fmt::format("{:.6f}", cost); }

/// Indented by how many solves it stands in.
std::string head(const char* solver, const std::string& of) {
  return std::string(2 * static_cast<std::size_t>(solves_on_this_thread - 1), ' ') + solver +
         (of.empty() ? "" : " (" + of + ")");
}

}  // namespace

bool SolverLog::enter() {
  if (!google::IsGoogleLoggingInitialized()) return false;
  ++solves_on_this_thread;
  return true;
}

void SolverLog::leave() { --solves_on_this_thread; }

void SolverLog::write_iteration(int number, double cost, double step, double gradient, Damping damping,
                                const char* file, int line) const {
  std::string text = fmt::format("{} {}: cost {}, step {}, gradient {}", head(solver_, {}), number,
                                 in_nats(cost), shortly(step), shortly(gradient));
  if (damping.name) text += fmt::format(", {} {}", damping.name, shortly(damping.value));
  tell(text, file, line);
}

void SolverLog::write_end(int iterations, double cost, double gradient, const char* how,
                          const std::string& reason, const char* file, int line) const {
  if (solves_on_this_thread > 1 && !VLOG_IS_ON(2)) return;
  std::string text = fmt::format("{}: {}", head(solver_, of_), how);
  if (iterations >= 0) text += fmt::format(" after {} iterations", iterations);
  if (!std::isnan(cost)) text += fmt::format(", cost {}", in_nats(cost));
  if (!std::isnan(gradient)) text += fmt::format(", gradient {}", shortly(gradient));
  if (!reason.empty()) text += ": " + reason;
  tell(text, file, line);
}

std::string curve_in_words(std::ptrdiff_t coefficients, NoiseLaw law) {
  return fmt::format("order {}, noise {}", coefficients - 1, to_string(law));
}

void tell(const std::string& text, const char* file, int line) {
  google::LogMessage(file, line, google::GLOG_INFO).stream() << text;
}

}  // namespace rangecal
