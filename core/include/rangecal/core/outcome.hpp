// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace rangecal {

/// How an estimate ended. An unlucky solve is an outcome with a reason, never an exception.
enum class Outcome {
  converged,      ///< an optimum (or a closed form) was reached
  not_converged,  ///< iterations ran out before the stopping rule held
  unbounded,      ///< the likelihood has no maximum: a sigma goes to 0
  unobservable,   ///< a direction of the parameters is not determined by the data; the rest is delivered
  too_few_data,   ///< fewer readings, stops, landmarks or distances than the model has unknowns
  failed          ///< the numbers left the domain of the model (reason says how)
};

/// "converged", "not_converged", "unbounded", "unobservable", "too_few_data", "failed".
const char* to_string(Outcome outcome);
/// The inverse of to_string; throws InputError for another text.
Outcome outcome_from_string(const std::string& text);

/// True if the estimate may be used (converged, or unobservable with its weak direction named).
inline bool is_usable(Outcome outcome) {
  return outcome == Outcome::converged || outcome == Outcome::unobservable;
}

}  // namespace rangecal
