// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"

namespace rangecal {

/// The density of the standardised error z = (y - f(d)) / s(d), dimensionless. s is the standard deviation of
/// y for the Gaussian, the scale for the others.
enum class NoiseShape {
  gaussian,      ///< N(0, 1)
  student_t,     ///< Student's t with nu > 1 degrees of freedom, scale 1
  contaminated,  ///< (1 - p) N(0, 1) + p N(0, k^2), 0 < p < 1/2, 3 <= k <= 1000
  one_sided,     ///< (1 - p) N(0, 1) + p (N(0, 1) +- Exp), 0 < p < 1/2: late returns (+) or early echoes (-)
  automatic      ///< the one with the lowest AIC
};

/// "gaussian", "student-t", "contaminated", "one-sided", "auto".
const char* to_string(NoiseShape shape);
/// The inverse of to_string; throws InputError naming the accepted texts.
NoiseShape noise_shape_from_string(const std::string& text);

/// A shape with its parameters; only those of the shape are read.
struct NoiseShapeParameters {
  NoiseShape shape = NoiseShape::gaussian;
  double nu = 4.0;              ///< Student-t
  double outlier_share = 0.1;   ///< p
  double outlier_scale = 10.0;  ///< k
  /// Mean of a one-sided outlier's exponential part, in the unit of the reading [m, rad]: > 0 late, < 0 early.
  double outlier_mean = 0.3;

  static constexpr double nu_min = 1.0, nu_max = 200.0;
  static constexpr double scale_min = 3.0, scale_max = 1000.0;
  /// A share larger than these is no outlier's but half of a wrong model's.
  static constexpr double share_max = 0.49, one_sided_share_max = 0.3;
};

/// Free parameters of the shape: 0, 1 (nu), 2 (p, k), 2 (p, outlier_mean). `automatic` has none of its own.
int shape_parameter_count(NoiseShape shape);

/// The shape as a calibration holds it, with the standard deviations of its parameters in their order (empty: none are
/// known); none for the Gaussian.
std::optional<ShapeEstimate> shape_estimate(const NoiseShapeParameters& shape,
                                            const std::vector<double>& deviations);
/// The shape of a calibration's "range" or "bearing"; the Gaussian where it holds none. Throws InputError for a family
/// that is no shape's name.
NoiseShapeParameters noise_shape_of(const Calibration& calibration, const std::string& channel);

/// The contaminated normal at z: log[(1 - p) exp(-z^2 / 2) + (p / k) exp(-z^2 / (2 k^2))] [nats], the normal's
/// constant -log(2 pi) / 2 left out, for a share 0 < p < 1 and a ratio k > 0 of any size. Finite at every finite z
/// whose square is, though both terms underflow from |z| = 39 k on.
struct ContaminatedDensity {
  double log_density = 0.0;
  double outlier = 0.0;  ///< probability that z is of the share p
  double weight = 1.0;   ///< 1 - outlier + outlier / k^2: of z^2 in the equivalent Gaussian
};
ContaminatedDensity contaminated_density(double p, double k, double z);

/// z of a one-sided outlier alone, N(0, 1) + Exp of mean lambda (exponentially modified Gaussian; Grushka 1972):
///
///   log h(z) = -log lambda + 1 / (2 lambda^2) - z / lambda + log Phi(x),   x = z - 1 / lambda.
///
/// Given z the exponential part is a normal of mean x and variance 1 cut off below 0: M = phi(x) / Phi(x),
/// mean m = x + M, variance 1 - M (x + M). Finite at every finite z whose square is.
///
/// Where the exponential part ends at L, Phi(x) becomes Phi(x) - Phi(x - L), the density is divided by
/// 1 - exp(-L / lambda), and the normal is cut off above L, too. lambda far above L: even between 0 and L.
struct OneSidedDensity {
  double log_density = 0.0;  ///< with the normal's constant [nats]
  double mean = 0.0, variance = 0.0;
};
/// True if an end at L cuts next to nothing off of the normal of mean x: then all but the division is as without it.
bool ends_out_of_reach(double x, double end);
/// 1 - exp(-L / lambda), what of the exponential part lies before an end at L.
double share_before_end(double lambda, double end);
OneSidedDensity one_sided_density(double lambda, double z,
                                  double end = std::numeric_limits<double>::infinity());
/// Its cumulative probability, with E = exp(-L / lambda) (by parts):
///   H(z) = Phi(z - L) + (Phi(z) - Phi(z - L)) / (1 - E) - lambda h(z).
double one_sided_cumulative(double lambda, double z, double end = std::numeric_limits<double>::infinity());

/// log density of z [nats], with its first derivative in z, and what expectation and maximisation (Dempster, Laird,
/// Rubin 1977) take from a reading: a Gaussian whose error is z - shift and whose squares are
/// weight (z - shift)^2 + extra_square. `s` (the reading's spread, in the unit of outlier_mean) matters to the one-sided
/// shape alone. Throws InputError for `automatic`.
struct LogDensity {
  double value = 0.0, derivative = 0.0;  ///< derivative = -weight (z - shift)
  double weight = 1.0;                   ///< the robust weight of z^2 in the equivalent Gaussian
  double shift = 0.0, extra_square = 0.0;
  /// Probability that z is one of the share p; of Student's t, which has none, what its weight lacks of 1; Gaussian: 0.
  double outlier = 0.0;
  double in_log_s = 0.0;  ///< derivative in log s at fixed z (one-sided: its mean is no multiple of s)
  double in_shape[2] = {0.0,
                        0.0};  ///< derivatives in the shape's parameters: nu; p and k; p and outlier_mean
};
LogDensity log_density(const NoiseShapeParameters& shape, double z, double s = 1.0);

/// The same for many z: what does not depend on z is worked out once.
class ShapeDensity {
 public:
  explicit ShapeDensity(const NoiseShapeParameters& shape);
  LogDensity operator()(double z, double s = 1.0) const;

 private:
  LogDensity mixture(double z, double s) const;

  NoiseShapeParameters shape_;
  double constant_ = 0.0, in_nu_ = 0.0;
  double log_body_ = 0.0, log_wide_ = 0.0;  ///< log(1 - p); log(p / k), of a one-sided shape log p
};

/// Standard deviation of z: 1, sqrt(nu / (nu - 2)) (infinite for nu <= 2), sqrt(1 - p + p k^2),
/// sqrt(1 + p (2 - p) lambda^2) with lambda = outlier_mean / s.
double standard_deviation(const NoiseShapeParameters& shape, double s = 1.0);

/// What one reading y = f + s z, z of the shape, is expected to tell, as information matrices of its
/// parameters:
///
///   location:  s^2 E[(d log p / df)^2] = E[w^2 z^2]                                  (Gaussian: 1)
///   weight:    E[w]                                                                  (Gaussian: 1)
///   spread:    E[u u^T],  u = d log p / d(log s, nu) = (w z^2 - 1, d log rho / dnu)  (Gaussian: 2)
///              or d(log s, p, k), d(log s, p, outlier_mean)
///
/// dimensionless, 1/nu, ...; w the robust weight. E[w z^2] = 1 for every even shape; E[w] = 1 for Student's t and
/// the one-sided shape, 1 - p + p / k^2 for the contaminated normal. Location and spread are not coupled where rho is
/// even; that they are a little in the one-sided shape is left out.
/// Student's t has location (nu + 1) / (nu + 3) and 2 nu / (nu + 3) for log s: Lange, Little, Taylor 1989,
/// appendix B. Here all by the trapezoidal rule in arsinh z, which is good to some 1e-10. Throws InputError
/// for `automatic`.
struct ShapeInformation {
  double location = 1.0, weight = 1.0;
  Eigen::MatrixXd spread = Eigen::MatrixXd::Constant(1, 1, 2.0);  ///< of log s, then the shape's parameters
};
ShapeInformation shape_information(const NoiseShapeParameters& shape, double s = 1.0);

/// A parameter of the shape stands at an end of its range (nu at 1 or 200, p at 0, a one-sided mean of 3 spreads, ...),
/// where the likelihood is flat along it and it has no standard deviation.
bool at_limit(const NoiseShapeParameters& shape, double s = 1.0);

}  // namespace rangecal
