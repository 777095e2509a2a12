// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/serial_errors.hpp"

#include <algorithm>
#include <cmath>

#include "diagnosis/wandering_part.hpp"

namespace rangecal::diagnosis {

int Sequence::links() const {
  return static_cast<int>(std::count_if(before.begin(), before.end(), [](int row) { return row >= 0; }));
}

Sequence Sequence::of(const std::vector<int>& kept) const {
  Sequence part;
  if (empty()) return part;
  std::vector<int> number(before.size(), -1);
  for (std::size_t i = 0; i < kept.size(); ++i)
    number[static_cast<std::size_t>(kept[i])] = static_cast<int>(i);
  for (const int row : order)
    if (number[static_cast<std::size_t>(row)] >= 0)
      part.order.push_back(number[static_cast<std::size_t>(row)]);
  for (const int row : kept) {
    int from = before[static_cast<std::size_t>(row)];
    double distance = gap[static_cast<std::size_t>(row)];
    while (from >= 0 && number[static_cast<std::size_t>(from)] < 0) {
      distance += gap[static_cast<std::size_t>(from)];
      from = before[static_cast<std::size_t>(from)];
    }
    part.before.push_back(from < 0 ? -1 : number[static_cast<std::size_t>(from)]);
    part.gap.push_back(from < 0 ? 0.0 : distance);
  }
  return part;
}

SerialErrors::SerialErrors(const Sequence& sequence, double q, double rho)
    : SerialErrors(sequence, q, rho, {}, {}) {}

SerialErrors::SerialErrors(const Sequence& sequence, double q, double rho, const Eigen::VectorXd& weight,
                           const Eigen::VectorXd& curvature) {
  if (sequence.empty() || !(q > 0.0) || !(rho > 0.0)) return;
  const std::size_t n = sequence.order.size();
  order_ = sequence.order;
  before_ = sequence.before;
  for (auto* column : {&phi_, &gain_, &root_}) column->resize(n);
  part_.assign(n, 1.0);
  WanderingPart part(sequence, q, rho);
  for (const int row : order_) {
    const auto i = static_cast<std::size_t>(row);
    const WanderingPart::Prediction before = part.before(row);
    part.leave(row, 0.0, before.variance_behind(weight.size() > 0 ? curvature[row] : 1.0));
    phi_[i] = before.correlation;
    if (weight.size() > 0) part_[i] = std::sqrt(weight[row]);
    gain_[i] = before.variance / before.error_variance * part_[i];  // of a surprise sqrt(w_i) times as large
    root_[i] = before.spread();
    log_determinant_ += std::log(before.error_variance);
  }
}

Eigen::VectorXd SerialErrors::whitened(Eigen::VectorXd e) const {
  if (independent()) return e;
  Eigen::VectorXd x(e.size());  // of each row, given the readings up to it
  for (const int i : order_) {
    const auto row = static_cast<std::size_t>(i);
    const double expected = before_[row] < 0 ? 0.0 : phi_[row] * x[before_[row]];
    const double surprise = e[i] - part_[row] * expected;
    x[i] = expected + gain_[row] * surprise;
    e[i] = surprise / root_[row];
  }
  return e;
}

SerialErrors::Columns SerialErrors::whitened_columns(Columns E) const {
  if (independent()) return E;
  const Eigen::Index columns = E.cols();
  Columns X(E.rows(), columns);  // of each row, given the readings up to it
  for (const int i : order_) {
    const auto row = static_cast<std::size_t>(i);
    const double phi = before_[row] < 0 ? 0.0 : phi_[row], gain = gain_[row], part = part_[row],
                 scale = 1.0 / root_[row];
    const double* before = X.data() + columns * std::max(before_[row], 0);
    double* const e = E.data() + columns * i;
    double* const x = X.data() + columns * i;
    for (Eigen::Index j = 0; j < columns; ++j) {
      const double expected = phi > 0.0 ? phi * before[j] : 0.0, surprise = e[j] - part * expected;
      x[j] = expected + gain * surprise;
      e[j] = scale * surprise;
    }
  }
  return E;
}

Eigen::VectorXd SerialErrors::transposed(const Eigen::VectorXd& u) const {
  if (independent()) return u;
  Eigen::VectorXd result(u.size()), of_x = Eigen::VectorXd::Zero(u.size());  // slopes in x of each row
  for (auto at = order_.rbegin(); at != order_.rend(); ++at) {
    const auto row = static_cast<std::size_t>(*at);
    result[*at] = u[*at] / root_[row] + gain_[row] * of_x[*at];
    if (before_[row] >= 0) of_x[before_[row]] += phi_[row] * (of_x[*at] - part_[row] * result[*at]);
  }
  return result;
}

Eigen::VectorXd SerialErrors::transpose_coloured(const Eigen::VectorXd& v) const {
  if (independent()) return v;
  Eigen::VectorXd u(v.size()), of_x = Eigen::VectorXd::Zero(v.size());
  for (auto at = order_.rbegin(); at != order_.rend(); ++at) {  // as `transposed`, solved for u
    const auto row = static_cast<std::size_t>(*at);
    u[*at] = root_[row] * (v[*at] - gain_[row] * of_x[*at]);
    if (before_[row] >= 0) of_x[before_[row]] += phi_[row] * (of_x[*at] - part_[row] * v[*at]);
  }
  return u;
}

Eigen::VectorXd SerialErrors::coloured(const Eigen::VectorXd& u) const {
  if (independent()) return u;
  Eigen::VectorXd e(u.size()), x(u.size());
  for (const int i : order_) {
    const auto row = static_cast<std::size_t>(i);
    const double expected = before_[row] < 0 ? 0.0 : phi_[row] * x[before_[row]];
    const double surprise = root_[row] * u[i];
    x[i] = expected + gain_[row] * surprise;
    e[i] = part_[row] * expected + surprise;
  }
  return e;
}

}  // namespace rangecal::diagnosis
