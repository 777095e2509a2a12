// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

namespace rangecal {

/// The assignment of rows to columns, each at most once, of the least sum of costs, where leaving a row without a
/// column costs `unassigned`. Returns the column of each row or -1. Costs may be infinite (forbidden), not NaN or
/// negative infinite. Hungarian method with potentials (Kuhn 1955; shortest augmenting paths). Cost: O(rows^2 (rows +
/// columns)).
std::vector<int> assign(const Eigen::MatrixXd& cost, double unassigned);

}  // namespace rangecal
