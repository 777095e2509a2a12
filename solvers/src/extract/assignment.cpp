// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/extract/assignment.hpp"

#include <limits>

namespace rangecal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Adds row `row` (1-based) to the matching by the shortest augmenting path; column 0 is a sentinel that holds the row.
void augment(const Eigen::MatrixXd& cost, int row, std::vector<double>& u, std::vector<double>& v,
             std::vector<int>& row_of) {
  const int columns = static_cast<int>(cost.cols());
  const auto at = [](auto& list, int i) -> auto& { return list[static_cast<std::size_t>(i)]; };
  std::vector<double> least(static_cast<std::size_t>(columns) + 1, kInfinity);
  std::vector<int> via(static_cast<std::size_t>(columns) + 1, 0);
  std::vector<char> done(static_cast<std::size_t>(columns) + 1, 0);
  at(row_of, 0) = row;
  int column = 0;
  do {
    at(done, column) = 1;
    const int here = at(row_of, column);
    double delta = kInfinity;
    int next = 0;
    for (int j = 1; j <= columns; ++j) {
      if (at(done, j)) continue;
      const double reduced = cost(here - 1, j - 1) - at(u, here) - at(v, j);
      if (reduced < at(least, j)) at(least, j) = reduced, at(via, j) = column;
      if (at(least, j) < delta) delta = at(least, j), next = j;
    }
    for (int j = 0; j <= columns; ++j) {
      if (at(done, j)) {
        at(u, at(row_of, j)) += delta, at(v, j) -= delta;
      } else {
        at(least, j) -= delta;
      }
    }
    column = next;
  } while (at(row_of, column) != 0);
  for (; column != 0; column = at(via, column)) at(row_of, column) = at(row_of, at(via, column));
}

}  // namespace

std::vector<int> assign(const Eigen::MatrixXd& cost, double unassigned) {
  const int rows = static_cast<int>(cost.rows()), columns = static_cast<int>(cost.cols());
  // One column more for each row, for staying alone; a forbidden pair costs more than all of them together.
  const double forbidden = 2.0 * unassigned * (rows + 1) + 1.0;
  Eigen::MatrixXd full(rows, columns + rows);
  for (int i = 0; i < rows; ++i) {
    for (int j = 0; j < columns; ++j) full(i, j) = cost(i, j) < forbidden ? cost(i, j) : forbidden;
    for (int j = 0; j < rows; ++j) full(i, columns + j) = unassigned;
  }
  std::vector<double> u(static_cast<std::size_t>(rows) + 1, 0.0),
      v(static_cast<std::size_t>(columns + rows) + 1, 0.0);
  std::vector<int> row_of(static_cast<std::size_t>(columns + rows) + 1, 0);
  for (int row = 1; row <= rows; ++row) augment(full, row, u, v, row_of);
  std::vector<int> column_of(static_cast<std::size_t>(rows), -1);
  for (int j = 1; j <= columns; ++j) {
    const int row = row_of[static_cast<std::size_t>(j)];
    if (row > 0 && cost(row - 1, j - 1) < forbidden) column_of[static_cast<std::size_t>(row - 1)] = j - 1;
  }
  return column_of;
}

}  // namespace rangecal
