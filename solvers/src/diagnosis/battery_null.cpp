// SPDX-License-Identifier: BSD-3-Clause
// What the battery's p-values are worth together: its smallest ones, simulated under the fitted model.
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <utility>

#include "diagnosis/battery.hpp"
#include "diagnosis/skewed_score.hpp"
#include "in_parallel.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double tail = Rates::tail;
/// Draws of a family whose largest statistic is turned into a p-value: the smallest of all lies among them.
constexpr double worth_a_p_value = 0.15, worth_together = 10.0;
constexpr int fewest_for_a_law = 100;  ///< draws below which the scalar tests keep their asymptotic laws
constexpr Eigen::Index most_numbers = 1000000, most_together = 100;  ///< held at a time, by each thread

}  // namespace

/// Per family and number of degrees of freedom the largest statistic of every draw: the p-value falls with the statistic, and only that of
/// the largest is worth one.
class Battery::NullLargest {
 public:
  struct Largest {
    int dof = 1;
    int family = 0;
    Eigen::VectorXd statistic;  // per draw
  };

  NullLargest(const std::vector<Question>& questions, int draws) {
    for (const Question& q : questions) {
      const int family = family_of.try_emplace(q.family, static_cast<int>(family_of.size())).first->second;
      Largest& entry = all[{family, q.dof}];
      if (entry.statistic.size() == 0) entry = {q.dof, family, Eigen::VectorXd::Zero(draws)};
      of_question_.push_back(&entry.statistic);
    }
  }
  NullLargest(const NullLargest&) = delete;
  NullLargest& operator=(const NullLargest&) = delete;

  void see(std::size_t question, Eigen::Index draw, double statistic) {
    double& most = (*of_question_[question])[draw];
    most = std::max(most, statistic);
  }

  std::map<std::string, int> family_of;
  std::map<std::pair<int, int>, Largest> all;  ///< by family and dof

 private:
  std::vector<Eigen::VectorXd*> of_question_;
};

namespace {

/// Columns that are multiplied with what a block of draws holds, and the scores they add to. In single
/// precision: a point of a simulated law is known to a hundredth at best.
class ScoreColumns {
 public:
  explicit ScoreColumns(Eigen::Index rows) : rows_(rows) {}

  void add(const Eigen::VectorXd& column, Eigen::Index score) {
    if (column.size() == rows_ && column.squaredNorm() > 0.0) chosen_.emplace_back(&column, score);
  }
  /// After the last column.
  void settle() {
    values_.resize(rows_, static_cast<Eigen::Index>(chosen_.size()));
    for (Eigen::Index j = 0; j < values_.cols(); ++j)
      values_.col(j) = chosen_[static_cast<std::size_t>(j)].first->cast<float>();
  }
  /// What a block of draws holds, to be filled; no rows where there is no column.
  Eigen::MatrixXf block(Eigen::Index draws) const { return {chosen_.empty() ? 0 : rows_, draws}; }
  static void set(Eigen::MatrixXf& block, Eigen::Index draw, const Eigen::VectorXd& drawn) {
    if (block.rows() > 0) block.col(draw) = drawn.head(block.rows()).cast<float>();
  }
  /// scores += columns^T block
  template <typename Scores>
  void add_to(Scores&& scores, const Eigen::MatrixXf& block) const {
    if (chosen_.empty()) return;
    const Eigen::MatrixXf product = values_.transpose() * block;
    for (Eigen::Index j = 0; j < product.rows(); ++j)
      scores.row(chosen_[static_cast<std::size_t>(j)].second) += product.row(j);
  }

 private:
  Eigen::Index rows_;
  std::vector<std::pair<const Eigen::VectorXd*, Eigen::Index>> chosen_;
  Eigen::MatrixXf values_;
};

}  // namespace

void Battery::draw_statistics(int draws, std::uint64_t seed, NullLargest& largest) {
  const Eigen::Index units = 2 * projector_.cells(), n = static_cast<Eigen::Index>(rows_.size());
  ScoreColumns means(rows_.pairs ? projector_.cells() : units), range_rows(n), bearing_rows(n),
      range_variances(units), bearing_variances(units);
  bool within = false;
  for (std::size_t j = 0; j < mean_projected_.size(); ++j) {
    const auto score = static_cast<Eigen::Index>(j);
    means.add(mean_projected_[j], score);
    range_rows.add(mean_within_[j].range_rows, score);
    bearing_rows.add(mean_within_[j].bearing_rows, score);
    within = within || mean_within_[j].within();
  }
  for (std::size_t j = 0; j < variance_columns_.size(); ++j)
    (variance_of_bearing_[j] ? bearing_variances : range_variances)
        .add(variance_columns_[j], static_cast<Eigen::Index>(j));
  const NullDraws null(rows_, projector_, working_.problem, *scalar_tests_, range_units, bearing_units,
                       within);
  std::vector<std::size_t> scalar;  // questions
  for (std::size_t q = 0; q < questions.size(); ++q)
    if (questions[q].of == Question::Of::scalar) scalar.push_back(q);
  Eigen::MatrixXd scalars = Eigen::MatrixXd::Zero(draws, static_cast<Eigen::Index>(scalar.size()));
  for (ScoreColumns* columns : {&means, &range_rows, &bearing_rows, &range_variances, &bearing_variances})
    columns->settle();
  std::vector<std::vector<ScalarTest>> drawn_tests(static_cast<std::size_t>(draws));
  const auto mean_count = static_cast<Eigen::Index>(mean_projected_.size()),
             variance_count = static_cast<Eigen::Index>(variance_columns_.size());
  const auto together =
      std::clamp<Eigen::Index>(most_numbers / (3 * units + (within ? 2 * n : 0)), 1, most_together);
  const auto draw_block = [&](std::size_t which) {
    const Eigen::Index first = static_cast<Eigen::Index>(which) * together;
    const Eigen::Index count = std::min<Eigen::Index>(together, draws - first);
    Eigen::MatrixXf cells = means.block(count), rows_of_range = range_rows.block(count),
                    rows_of_bearing = bearing_rows.block(count), range_excess = range_variances.block(count),
                    bearing_excess = bearing_variances.block(count);
    for (Eigen::Index i = 0; i < count; ++i) {
      const Eigen::Index b = first + i;
      Random random(seed_from("battery", {seed, static_cast<std::uint64_t>(b)}));
      NullDraw draw = null.draw(random);
      ScoreColumns::set(cells, i, draw.cells);
      ScoreColumns::set(rows_of_range, i, draw.range_rows);
      ScoreColumns::set(rows_of_bearing, i, draw.bearing_rows);
      ScoreColumns::set(range_excess, i, 0.5 * draw.range_excess);
      ScoreColumns::set(bearing_excess, i, 0.5 * draw.bearing_excess);
      for (std::size_t t = 0; t < scalar.size(); ++t)  // by the law they are judged by
        for (int j = 0; j < questions[scalar[t]].dof; ++j)
          scalars(b, static_cast<Eigen::Index>(t)) += std::pow(random.normal(), 2);
      drawn_tests[static_cast<std::size_t>(b)] = std::move(draw.scalars);
    }
    Eigen::MatrixXf of_means = Eigen::MatrixXf::Zero(mean_count, count),
                    of_variances = Eigen::MatrixXf::Zero(variance_count, count);
    means.add_to(of_means, cells);
    range_rows.add_to(of_means, rows_of_range);
    bearing_rows.add_to(of_means, rows_of_bearing);
    range_variances.add_to(of_variances, range_excess);
    bearing_variances.add_to(of_variances, bearing_excess);
    for (Eigen::Index i = 0; i < count; ++i)
      for (std::size_t q = 0; q < questions.size(); ++q) {
        const Question& question = questions[q];
        if (question.of == Question::Of::mean)
          largest.see(q, first + i,
                      of_means.col(i).segment(question.first_column, question.dof).squaredNorm());
        else if (question.of != Question::Of::scalar)
          largest.see(q, first + i,
                      skewed_chi_square(
                          of_variances.col(i).segment(question.first_column, question.dof).cast<double>(),
                          question.third_cumulants));
      }
  };
  in_parallel(static_cast<std::size_t>((draws + together - 1) / together), draw_block);
  if (draws >= fewest_for_a_law) standardise_by(drawn_tests, scalar, scalars);
  for (std::size_t t = 0; t < scalar.size(); ++t)
    for (Eigen::Index b = 0; b < draws; ++b)
      largest.see(scalar[t], b, scalars(b, static_cast<Eigen::Index>(t)));
}

void Battery::standardise_by(const std::vector<std::vector<ScalarTest>>& drawn,
                             const std::vector<std::size_t>& scalar, Eigen::MatrixXd& statistics) {
  const auto draws = static_cast<Eigen::Index>(drawn.size());
  rates.scalars.clear();
  std::vector<std::string> names;
  for (const ScalarTest& test : drawn.front()) names.push_back(test.name());
  Eigen::MatrixXd tests(static_cast<Eigen::Index>(names.size()), draws);
  for (Eigen::Index t = 0; t < tests.rows(); ++t) {
    for (Eigen::Index b = 0; b < draws; ++b)
      tests(t, b) = drawn[static_cast<std::size_t>(b)][static_cast<std::size_t>(t)].z;
    const double mean = tests.row(t).mean();
    const double variance = (tests.row(t).array() - mean).square().sum() / static_cast<double>(draws - 1);
    rates.scalars[names[static_cast<std::size_t>(t)]] = {mean, std::sqrt(std::max(variance, 1e-12))};
  }
  for (std::size_t t = 0; t < scalar.size(); ++t) {
    Question& question = questions[scalar[t]];
    if (!question.z) continue;
    const std::string name = ScalarTest::name_of(question.channel, question.shape);
    const auto test = std::find(names.begin(), names.end(), name);
    if (test == names.end()) continue;
    standardise(question);
    for (Eigen::Index b = 0; b < draws; ++b)
      statistics(b, static_cast<Eigen::Index>(t)) =
          std::pow(rates.standardised(name, tests(test - names.begin(), b)), 2);
  }
}

void Battery::calibrate(int draws, std::uint64_t seed) {
  NullLargest largest(questions, draws);
  draw_statistics(draws, seed, largest);
  for (auto* columns : {&mean_projected_, &variance_columns_}) std::vector<Eigen::VectorXd>().swap(*columns);
  std::vector<Signature>().swap(mean_within_);
  const auto independent = [&](double log_p) {
    return std::log1p(-tail) / std::log1p(-std::clamp(std::exp(log_p), 1e-12, 0.5));
  };
  const auto rank = static_cast<Eigen::Index>(std::max(0.0, tail * draws - 1.0));
  std::vector<double> independent_questions(largest.family_of.size(), 0.0);
  for (const auto& [key, entry] : largest.all) {
    Eigen::VectorXd sorted = entry.statistic;
    std::nth_element(sorted.begin(), sorted.begin() + rank, sorted.end(), std::greater<>());
    independent_questions[static_cast<std::size_t>(entry.family)] +=
        std::max(1.0, independent(log_chi_sq_survival(sorted[rank], entry.dof)));
  }
  std::vector<double>& smallest = rates.smallest;  // ln p, corrected within families
  smallest.assign(static_cast<std::size_t>(draws), 0.0);
  const double share =
      std::clamp(worth_together / static_cast<double>(largest.family_of.size()), worth_a_p_value, 1.0);
  for (const auto& [key, entry] : largest.all) {
    Eigen::VectorXd sorted = entry.statistic;  // the smallest of all lies among each family's best
    const auto worth = std::min<Eigen::Index>(static_cast<Eigen::Index>(share * draws), draws - 1);
    std::nth_element(sorted.begin(), sorted.begin() + worth, sorted.end(), std::greater<>());
    for (int b = 0; b < draws; ++b)
      if (entry.statistic[b] >= sorted[worth])
        smallest[static_cast<std::size_t>(b)] =
            std::min(smallest[static_cast<std::size_t>(b)],
                     log_of_smallest(log_chi_sq_survival(entry.statistic[b], entry.dof),
                                     independent_questions[static_cast<std::size_t>(entry.family)]));
  }
  for (const auto& [family, index] : largest.family_of)
    rates.within[family] = independent_questions[static_cast<std::size_t>(index)];
  // That point is known from tail * draws values beyond it only: one standard error on the safe side.
  const auto safe = static_cast<std::size_t>(std::max(0.0, tail * draws - std::sqrt(tail * draws) - 1.0));
  std::sort(smallest.begin(), smallest.end());
  rates.families = std::clamp(independent(smallest[safe]), 1.0, 1e7);
}

}  // namespace rangecal::diagnosis
