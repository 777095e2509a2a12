// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::app {

/// A diagnosis as a user reads it, at most 100 columns wide: verdict, before and after, where, parameters, what cannot
/// be told apart, what could be hidden, what to do next, notes.
std::string diagnosis_text(const Diagnosis& diagnosis);

/// Eight-level bars of the values between -limit and limit.
std::string sparkline(const std::vector<double>& values, double limit);

}  // namespace rangecal::app
