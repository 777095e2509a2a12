// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// Which second derivatives of the joint NLL stand in the matrix.
enum class HessianKind {
  fisher,  ///< expected information: positive semidefinite everywhere
  exact    ///< second derivatives at the point, as Laplace's method needs them
};

/// Where each unknown stands. Globals: gamma = (alpha, landmarks | tau, log sigma_theta, [log sigma_s]); the part
/// before the bar is phi, the part after it sigma. tau: log sigma of a power law, or beta. Stops are grouped into
/// nodes, one per place: (x, y) if the position has a prior with sigma > 0, then one heading per stop whose heading is not exact.
struct JointLayout {
  /// Refers to the problem's cells: the problem must outlive it.
  JointLayout(const JointProblem& problem, int alpha_count, int tau_count, bool sigma_s_free);
  JointLayout(JointLayout&&) noexcept = default;

  int alpha_count = 0, landmark_begin = 0, tau_begin = 0, tau_count = 0, sigma_theta = 0, sigma_s = -1;
  int phi_count = 0;  ///< alpha and landmarks
  int global_count = 0;
  int sigma_count() const { return global_count - phi_count; }

  struct Node {
    std::span<const int> stops;
    std::span<const int> heading;    ///< per stop of the node: its coordinate in the node, or -1 where exact
    std::span<const int> landmarks;  ///< distinct landmarks seen from here, ascending
    std::size_t block = 0;           ///< offset of the node's doubles in the arena
    int coordinate = 0;              ///< offset of its coordinates in the vector of all stop coordinates
    int dim = 0;                     ///< free coordinates
    int columns = 0;  ///< globals that the node couples to: alpha, sigmas, then two per landmark seen
    int first_cell =
        -1;  ///< its first cell, where its cells list its landmarks once and in order; else -1, see slot_of_cell_
    bool free_position = false;  ///< coordinates 0, 1 are the position error of the place
    bool chained = false;        ///< coupled to the node before
  };
  std::vector<Node> nodes;
  std::vector<int> node_of_stop, slot_of_stop;  ///< slot: index within Node::stops
  /// Index of the cell's landmark within Node::landmarks.
  int slot_of(const Node& node, int cell) const {
    return node.first_cell >= 0 ? cell - node.first_cell : slot_of_cell_[cell];
  }
  std::size_t arena = 0;  ///< doubles of all nodes' blocks
  int coordinates = 0;    ///< number of all stop coordinates
  bool chained = false;   ///< any node is coupled to its predecessor

 private:
  void describe_nodes(const JointProblem& problem);

  // Storage behind the nodes' spans, and slots of the cells of nodes that see a landmark more than once.
  std::vector<int> stops_, headings_, landmarks_, slot_of_cell_;
};

/// The joint NLL's value, gradient and Hessian in block form, and the elimination of the stops by Schur complement.
///
/// One pass over the cells fills per node its Hessian H (dim x dim), gradient g and coupling G to the few globals it
/// touches; a second pass eliminates it: S = H_gg - sum_nodes G^T H^-1 G. Independent nodes touch only their own
/// landmarks; a random walk is a block-tridiagonal chain, eliminated in order. Cost: linear in the cells and nodes
/// (times the number of globals for a chain). Large problems use all cores with a fixed split, so that the bits do
/// not depend on the number of threads.
class JointSystem {
 public:
  JointSystem(const JointProblem& problem, int alpha_count, int tau_count, bool sigma_s_free = false);
  ~JointSystem();
  JointSystem(JointSystem&&) noexcept;

  const JointLayout& layout() const { return layout_; }
  const JointProblem& problem() const { return problem_; }

  /// Fills all blocks at `state`. Returns the NLL, constants included; +infinity outside the model's domain.
  double assemble(const JointState& state, HessianKind kind);

  /// Optimises the stops of each node separately, the globals held, by damped Newton steps of that node alone, so that one bad node does
  /// not shorten the steps of the others. False, and nothing changed, if a node's Hessian does not become positive definite. Independent
  /// nodes only (no chain). The blocks are stale afterwards: call assemble().
  bool settle_nodes(JointState& state);

  /// Sets the two overall scales, of the ranges' spread and sigma_theta, to their joint minimum, everything else held:
  /// sigma^2 = sum W (e^2 + S^2) / u^2 / N with u = s / sigma, and likewise for the bearings.
  void profile_spreads(JointState& state) const;

  /// Eliminates the stops from the assembled blocks with their diagonals scaled by (1 + damping). False if a node's
  /// Hessian is not positive definite.
  bool eliminate(double damping = 0.0);
  /// The part of eliminate() that solve_stops() needs: the factors of the stops' own blocks.
  bool factor_stops(double damping = 0.0);

  /// After eliminate: Schur complement on the globals, gradient reduced to them, log det H_ss.
  const Eigen::MatrixXd& schur() const { return schur_; }
  const Eigen::VectorXd& reduced_gradient() const { return reduced_gradient_; }
  double log_det_stops() const { return log_det_stops_; }
  /// After assemble: gradient of the joint NLL with respect to the globals, and to all stop coordinates.
  const Eigen::VectorXd& global_gradient() const { return gradient_; }
  const Eigen::VectorXd& stop_gradient() const { return stop_gradient_; }

  /// After eliminate: the stop coordinates that go with a change of the globals: u = -H^-1 (g + G gamma) with
  /// `with_gradient`, else u = -H^-1 G gamma.
  Eigen::VectorXd back_substitute(const Eigen::VectorXd& globals, bool with_gradient) const;
  /// After eliminate or factor_stops: H^-1 rhs over the stop coordinates alone.
  Eigen::VectorXd solve_stops(Eigen::VectorXd rhs) const;
  /// G^T u: the globals' share of a vector over the stop coordinates.
  Eigen::VectorXd couple(const Eigen::VectorXd& stop_vector) const;

  /// After assemble(exact) and eliminate(0): gradient of 1/2 log det H_ss with respect to the globals, the stops
  /// following their conditional optimum (implicit function theorem).
  Eigen::VectorXd log_det_gradient(const JointState& state) const;
  /// After assemble(exact) and eliminate(0): gradient of 1/2 log det A with respect to the globals, A the Schur
  /// complement on phi, the stops following their conditional optimum. `phi_covariance`: A^-1 (phi_count square), zero in
  /// the rows and columns of what is held. Computed as that of 1/2 log det H - 1/2 log det H_ss, by the sum over cells
  /// of log_det_gradient with M = H^-1 - diag(0, H_ss^-1) = (1, -U)^T A^-1 (1, -U), U = H_ss^-1 G.
  Eigen::VectorXd log_det_phi_gradient(const JointState& state, const Eigen::MatrixXd& phi_covariance) const;
  /// Second derivatives of 1/2 log det H_ss in the sigmas (sigma_count square), every block scaling as 1 / sigma^2.
  Eigen::MatrixXd log_det_sigma_hessian(const JointState& state) const;
  /// Diagonal block of H_ss^-1 of a node.
  Eigen::MatrixXd stop_covariance(int node) const;

  /// After assemble: the whole Hessian over (globals, stop coordinates). For checks: its size is quadratic in the stops.
  Eigen::MatrixXd dense_hessian() const;

  /// Adds the blocks of another assembly of the same problem, scaled; for averages over draws.
  void accumulate(const JointSystem& other, double weight);
  void clear();

 private:
  struct Accumulator;
  struct Elimination;
  template <int NA>
  double assemble_node(const JointState& state, HessianKind kind, int node, Accumulator& sum);
  template <int NA>
  void assemble_part(const JointState& state, HessianKind kind, std::size_t begin, std::size_t end,
                     Accumulator& sum);
  template <int NA>
  bool settle_node(JointState& state, int node, Accumulator& unused);
  double assemble_priors(const JointState& state, bool exact, const JointLayout::Node& node,
                         Accumulator& sum);
  void collect(const std::vector<Accumulator>& parts);
  double assemble_chain_links(const JointState& state, HessianKind kind);
  double assemble_taped(const JointState& state, HessianKind kind);
  template <int D>
  bool eliminate_node(const JointLayout::Node& node, double damping, Elimination& sum);
  void flush(Elimination& sum, std::span<const int> next) const;
  bool factor_chain(double damping);
  template <int D>
  bool factor_link(std::size_t node, double damping);
  void eliminate_chain(double damping);
  template <int D>
  void eliminate_link(std::size_t node);
  template <int D>
  void substitute_link(std::size_t node, double* u) const;
  template <int D>
  void invert_link(std::size_t node) const;
  Eigen::MatrixXd coupling_solved() const;
  void selected_inverse() const;
  template <typename Covariance>
  Eigen::VectorXd trace_gradient(const JointState& state, Covariance& covariance) const;
  template <typename Covariance>
  void add_taped_trace(const JointState& state, const Covariance& covariance,
                       Eigen::VectorXd& by_global) const;
  const double* inverse_of_node(const JointLayout::Node& node) const {
    return inverse_diagonal_.data() + inverse_begin_[&node - layout_.nodes.data()];
  }
  Eigen::Map<const Eigen::MatrixXd> inverse_of(const JointLayout::Node& node) const {
    return {inverse_of_node(node), node.dim, node.dim};
  }

  const JointProblem& problem_;
  JointLayout layout_;
  double nll_ = 0.0, log_det_stops_ = 0.0;
  Eigen::VectorXd gradient_, stop_gradient_, reduced_gradient_;
  Eigen::MatrixXd hessian_, schur_;
  std::vector<double> arena_;               ///< per node: H, factor of H, G
  std::vector<double> bearing_direction_;   ///< per cell: cos, sin of the mean bearing
  std::vector<Accumulator> sums_;           ///< work space of assemble, one per part
  std::vector<Elimination> eliminations_;   ///< work space of eliminate
  std::vector<Eigen::MatrixXd> link_;       ///< chained: coupling block H_{k,k-1}
  std::vector<Eigen::MatrixXd> link_half_;  ///< chained: L_{k-1}^-1 H_{k,k-1}^T
  Eigen::MatrixXd chain_half_;              ///< chained: (L^-1 (G, g))^T, L the factor of the whole chain
  mutable std::vector<double> inverse_diagonal_;    ///< blocks of H_ss^-1
  mutable std::vector<std::size_t> inverse_begin_;  ///< where each node's begins
  mutable std::vector<Eigen::MatrixXd> inverse_below_;
  mutable bool inverse_valid_ = false;
};

/// state + step, where step = (globals, stop coordinates) in the layout's order; log-sigmas are exponentiated.
JointState step_state(const JointProblem& problem, const JointLayout& layout, const JointState& state,
                      const Eigen::VectorXd& globals, const Eigen::VectorXd& stops);

/// Moves the stops of a node by a step in its coordinates.
void move_node(const JointLayout::Node& node, const Eigen::Ref<const Eigen::VectorXd>& step,
               JointState& state);

/// The sigmas of a state in the layout's coordinates: logarithms, or the betas of a polynomial; the log of sigma_s, which the state
/// must have then, last where asked for.
Eigen::VectorXd sigma_coordinates(const JointState& state, bool with_sigma_s = false);

}  // namespace rangecal
