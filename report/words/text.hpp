// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/calibrate/residual_check.hpp"

namespace rangecal::app {

/// "0.0525 +- 0.0021": the value to the second digit of its standard deviation; alone where there is none.
std::string with_std(double value, std::optional<double> std_dev);

/// "m", "", "1/m", "1/m^2", ...: unit of a coefficient of d^power.
std::string coefficient_unit(int power, CurveFamily family = CurveFamily::polynomial);
/// "sigma_e f^2" and the like, and the unit of the law's parameter.
std::string law_in_words(NoiseLaw law);
std::string law_unit(NoiseLaw law, int index);

/// "3 recordings of kind landmarks: 30 stops, 15 landmarks, 500 readings".
std::string describe(std::span<const Recording> recordings);
/// "500 read, 498 used; dropped: 2 zero".
std::string describe(const Counts& counts);
/// "order 2, noise sigma_e f^2 (lowest AIC of 10 models; next: order 3, ...)", by the criterion that chose.
std::string describe_choice(const Calibration& calibration, const CalibrationReport& report);

/// "range noise is student-t with nu = 4, bearing noise is ..."; empty where all noise is Gaussian.
std::string shapes_in_words(const Calibration& calibration);
/// "do not use this curve: corrected readings are no better than raw ones (0.19 +- 0.01 against 0.18 +- 0.01 m RMS at stops left out); ...",
/// with the command that looks for the cause; empty where the curve is of use or that was not judged.
std::string not_usable_in_words(const Calibration& calibration, std::span<const Recording> recordings);
/// "readings of 10 stops left out: raw 311 +- 20 mm RMS, corrected 77 +- 5 mm; both halves ... agree (p = 0.41)"; empty where
/// there is no such check.
std::string left_out_in_words(const Calibration& calibration);
/// The p-value below which the curves of both halves of a recording are said to differ.
inline constexpr double halves_level = 0.01;
/// "the model does not hold: standard deviations by stops are 3.1 times as large ..."; empty where it does.
std::string misfit_in_words(const Calibration& calibration);
/// "5 of 1575 readings" and a line for each of the gravest; empty where the noise has no outliers.
std::string outlier_count_in_words(const Calibration& calibration);
std::vector<std::string> outlier_lines(const Calibration& calibration);

/// "31 of 1575 ranges and 12 of 1575 bearings lie beyond 4 sigma, where 0.1 and 0.1 would by chance".
std::string outliers_in_words(const ResidualCheck& check);
/// "repeats at one stop agree 5 times better than sigma_theta states"; empty where they do not.
std::string repeats_in_words(const ResidualCheck& check);

/// True where the curve is an answer: converged, or only something else than the curve is left open.
bool has_answer(const Calibration& calibration);

/// A reason that says the same of many landmarks, with the first of them and how many more there are.
std::string shortened(const std::string& reason);

/// Text broken at spaces to lines of `width`, each after the first indented.
std::string wrapped(const std::string& text, std::size_t indent, std::size_t width = 100);

}  // namespace rangecal::app
