// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>

namespace rangecal {

/// The density of the standardised error z = (y - f(d)) / s(d), dimensionless. s is the standard deviation of
/// y for the Gaussian, the scale for the others.
enum class NoiseShape {
  gaussian,      ///< N(0, 1)
  student_t,     ///< Student's t with nu > 1 degrees of freedom, scale 1
  contaminated,  ///< (1 - p) N(0, 1) + p N(0, k^2), 0 < p < 1/2, 3 <= k <= 30
  automatic      ///< the one with the lowest AIC
};

/// "gaussian", "student-t", "contaminated", "auto".
const char* to_string(NoiseShape shape);
/// The inverse of to_string; throws InputError naming the accepted texts.
NoiseShape noise_shape_from_string(const std::string& text);

/// A shape with its parameters; only those of the shape are read.
struct NoiseShapeParameters {
  NoiseShape shape = NoiseShape::gaussian;
  double nu = 4.0;              ///< Student-t
  double outlier_share = 0.1;   ///< p
  double outlier_scale = 10.0;  ///< k

  static constexpr double nu_min = 1.0, nu_max = 200.0;
  static constexpr double scale_min = 3.0, scale_max = 30.0;
};

/// Free parameters of the shape: 0, 1 (nu), 2 (p, k). `automatic` has none of its own.
int shape_parameter_count(NoiseShape shape);

/// The contaminated normal at z: log[(1 - p) exp(-z^2 / 2) + (p / k) exp(-z^2 / (2 k^2))] [nats], the normal's
/// constant -log(2 pi) / 2 left out, for a share 0 < p < 1 and a ratio k > 0 of any size. Finite at every finite z
/// whose square is, though both terms underflow from |z| = 39 k on.
struct ContaminatedDensity {
  double log_density = 0.0;
  double outlier = 0.0;  ///< probability that z is of the share p
  double weight = 1.0;   ///< 1 - outlier + outlier / k^2: of z^2 in the equivalent Gaussian
};
ContaminatedDensity contaminated_density(double p, double k, double z);

/// log density of z [nats], with its first derivative in z. Throws InputError for `automatic`.
struct LogDensity {
  double value = 0.0, derivative = 0.0;
  double weight = 1.0;              ///< -derivative / z: the robust weight of z^2 in the equivalent Gaussian
  double in_shape[2] = {0.0, 0.0};  ///< derivatives in the shape's parameters: nu, or p and k
};
LogDensity log_density(const NoiseShapeParameters& shape, double z);

/// The same for many z: what does not depend on z is worked out once.
class ShapeDensity {
 public:
  explicit ShapeDensity(const NoiseShapeParameters& shape);
  LogDensity operator()(double z) const;

 private:
  NoiseShapeParameters shape_;
  double constant_ = 0.0, in_nu_ = 0.0;
};

/// Standard deviation of z: 1, sqrt(nu / (nu - 2)) (infinite for nu <= 2), sqrt(1 - p + p k^2).
double standard_deviation(const NoiseShapeParameters& shape);

/// What one reading y = f + s z, z of the shape, is expected to tell, as information matrices of its
/// parameters:
///
///   location:  s^2 E[(d log p / df)^2] = E[w^2 z^2]                                  (Gaussian: 1)
///   weight:    E[w]                                                                  (Gaussian: 1)
///   spread:    E[u u^T],  u = d log p / d(log s, nu) = (w z^2 - 1, d log rho / dnu)  (Gaussian: 2)
///              or d(log s, p, k)
///
/// dimensionless, 1/nu, ...; w the robust weight. E[w z^2] = 1 for every shape; E[w] = 1 for Student's t,
/// 1 - p + p / k^2 for the contaminated normal. Location and spread are not coupled, rho being even.
/// Student's t has location (nu + 1) / (nu + 3) and 2 nu / (nu + 3) for log s: Lange, Little, Taylor 1989,
/// appendix B. Here all by the trapezoidal rule in arsinh z, which is good to some 1e-10. Throws InputError
/// for `automatic`.
struct ShapeInformation {
  double location = 1.0, weight = 1.0;
  Eigen::MatrixXd spread = Eigen::MatrixXd::Constant(1, 1, 2.0);  ///< of log s, then the shape's parameters
};
ShapeInformation shape_information(const NoiseShapeParameters& shape);

/// A parameter of the shape stands at an end of its range (nu at 1 or 200, p at 0, ...), where the likelihood
/// is flat along it and it has no standard deviation.
bool at_limit(const NoiseShapeParameters& shape);

}  // namespace rangecal
