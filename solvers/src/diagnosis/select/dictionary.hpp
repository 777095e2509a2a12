// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <vector>

#include "diagnosis/projector.hpp"
#include "diagnosis/refit.hpp"
#include "diagnosis/select/curve_places.hpp"

namespace rangecal::diagnosis {

/// One effect at one start of its grid, or a curve without a name of one size, as the linearised problem sees it.
struct Block {
  const Effect* effect = nullptr;
  std::string member;           ///< name, which all starts and sizes share
  double tau = 0.0;             ///< of a curve: standard deviation of its parameters' prior; 0: of a name
  Eigen::VectorXd start;        ///< its parameters
  std::vector<int> parameters;  ///< those that its columns are of
  int first = 0, size = 0;      ///< its columns
  double choices = 1.0;         ///< starts, or shapes and sizes, that it is one of
};

/// What every effect on the means would do to the readings, to first order about a fit:
///
///   y = sum_i x_i theta_i + noise
///
/// y is what the fit leaves, with its own effects on the means put back. With P of the Projector, which takes out what the
/// calibration can absorb,
///
///   G_ij = x_i^T P x_j,   g_i = x_i^T P y:
///
/// the columns of a set have the estimate theta = G^-1 g and gain g^T G^-1 g / 2 nats over the seed model. Cost: linear in
/// the cells for every column, and for every column of a set linear in the columns of all.
class Dictionary {
 public:
  /// Every effect on the means at every start of its grid, `curves`, and the fit's own at their parameters. Effects on spreads,
  /// tails and dependence stay as the fit has them.
  Dictionary(const Rows& rows, const Fit& fit, const std::vector<CurvePlace>& curves);
  Dictionary(const Dictionary&) = delete;  ///< the projector refers to the working problem

  const std::vector<Block>& blocks() const { return blocks_; }
  const Eigen::VectorXd& scores() const { return scores_; }
  /// Row of G, made with those of its block when it is first asked for.
  const Eigen::VectorXd& gram(int column);
  /// The part of G of a block's own columns.
  const Eigen::MatrixXd& own(std::size_t block) const { return own_[block]; }

 private:
  /// White deviations within the cells of a column, times the roots of their information; empty where it has none.
  struct Within {
    int column = 0;
    Eigen::VectorXd range, bearing;
  };
  struct Made;
  Made made_of(const Effect& effect, const Eigen::VectorXd& start, const std::vector<int>& parameters,
               Eigen::Ref<Eigen::MatrixXd> columns) const;
  void add_grams_of_block(int column);

  const Rows& rows_;
  WorkingProblem working_;
  Projector projector_;
  std::vector<Block> blocks_;
  Eigen::MatrixXd
      columns_;  ///< x_i: over the cells' ranges and, but for pairs, bearings; of scores_.size() columns
  std::vector<Within> within_;
  std::vector<Eigen::MatrixXd> own_;
  Eigen::VectorXd scores_;
  std::map<int, Eigen::VectorXd> gram_;
};

}  // namespace rangecal::diagnosis
