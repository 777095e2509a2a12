// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/linear_search.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>

#include "diagnosis/select/hypothesis.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double linear_window = 6.0;  ///< nats below the best set down to which sets are looked at
constexpr int most_looked_at = 40;     ///< sets
constexpr std::size_t branches = 8;    ///< likeliest sets that one move makes of a set
constexpr int most_for_pairs = 2;      ///< sets to which two names are added at once
constexpr double hidden = 3.0;         ///< nats that these gain together beyond what they gain alone
constexpr int most_split = 4;          ///< sets whose curves give way to two names at once

using Key = std::vector<std::string>;  ///< member names, sorted

/// True if other columns explain a block: one column keeps less than 1e-4 of its information, or every column less than 1e-2. At 1e-2 a tenth
/// of the score is left, near the few per cent by which the linearisation is off.
bool is_spanned(const Eigen::VectorXd& left, const Eigen::VectorXd& own) {
  constexpr double none_of_one = 1e-4, little_of_all = 1e-2;
  return !(left.array() > none_of_one * own.array()).all() ||
         (left.array() < little_of_all * own.array()).all();
}

class LinearSearch {
 public:
  LinearSearch(const Rows& rows, Dictionary& dictionary, const MemberCounts& counts,
               const SelectionPriors& priors)
      : rows_(rows), dictionary_(dictionary), counts_(counts), priors_(priors) {}

  std::vector<LinearSet> run(const Model& start) {
    keep(evaluated({}));
    std::vector<int> blocks;  // those at the fit's own parameters come first in the dictionary
    for (const ActiveEffect& active : start)
      for (std::size_t b = 0; b < dictionary_.blocks().size(); ++b)
        if (dictionary_.blocks()[b].effect == active.effect) {
          blocks.push_back(static_cast<int>(b));
          break;
        }
    if (!blocks.empty()) keep(evaluated(blocks));
    climb_by_names({});
    if (std::erase_if(blocks, [&](int b) { return is_curve(b); }) > 0) climb_by_names(blocks);
    for (int looked_at = 0; looked_at < most_looked_at; ++looked_at) {
      const Key* next = nullptr;
      double best = -std::numeric_limits<double>::infinity(), of_next = best;
      for (const auto& [key, set] : sets_) {
        best = std::max(best, set.log_posterior);
        if (looked_.count(key) || !(set.log_posterior > of_next)) continue;
        next = &key;
        of_next = set.log_posterior;
      }
      if (!next || (of_next < best - linear_window && looked_at > 1)) break;
      looked_.insert(*next);
      look_at(sets_.at(*next).blocks, looked_at < most_for_pairs, looked_at < most_split);
    }
    std::vector<LinearSet> out;
    for (auto& [key, set] : sets_) out.push_back(std::move(set));
    std::stable_sort(out.begin(), out.end(), [](const LinearSet& a, const LinearSet& b) {
      return a.log_posterior > b.log_posterior;
    });
    return out;
  }

 private:
  const Block& block(int b) const { return dictionary_.blocks()[static_cast<std::size_t>(b)]; }

  bool is_curve(int b) const { return is_generic(*block(b).effect); }

  Key key_of(const std::vector<int>& blocks) const {
    Key key;
    for (const int b : blocks) key.push_back(block(b).member);
    std::sort(key.begin(), key.end());
    return key;
  }

  /// Precision of the prior of every column: 1 / tau^2 of curves; of names that of a value far beyond the typical, so that a direction
  /// of which the calibration leaves next to nothing predicts no gain.
  Eigen::VectorXd ridge_of(const std::vector<int>& blocks) const {
    std::vector<double> ridge;
    for (const int b : blocks)
      for (const int j : block(b).parameters) ridge.push_back(ridge_of(block(b), j));
    return Eigen::Map<const Eigen::VectorXd>(ridge.data(), static_cast<Eigen::Index>(ridge.size()));
  }

  double ridge_of(const Block& one, int parameter) const {
    if (one.tau > 0.0) return 1.0 / (one.tau * one.tau);
    const auto [low, high] = one.effect->bounds(rows_.context, static_cast<std::size_t>(parameter));
    const double typical = one.effect->info().parameters[static_cast<std::size_t>(parameter)].typical;
    constexpr double far = 30.0;  // typical sizes
    const double width = std::min(std::max(std::abs(low), std::abs(high)), far * std::abs(typical));
    return width > 0.0 ? 1.0 / (width * width) : 0.0;
  }

  void keep(LinearSet set) {
    Key key = key_of(set.blocks);
    const auto known = sets_.find(key);
    if (known == sets_.end())
      sets_.emplace(std::move(key), std::move(set));
    else if (set.log_posterior > known->second.log_posterior + 1e-6) {
      known->second = std::move(set);
      looked_.erase(key);
    }
  }

  /// Normal equations (G + R) theta = g of a set's columns, R the precision of their prior.
  struct Normal {
    std::vector<int> columns;
    Eigen::MatrixXd G;  ///< R included
    Eigen::VectorXd g;
  };
  Normal normal_of(const std::vector<int>& blocks) {
    Normal normal;
    for (const int b : blocks)
      for (int c = 0; c < block(b).size; ++c) normal.columns.push_back(block(b).first + c);
    const auto k = static_cast<Eigen::Index>(normal.columns.size());
    normal.G.resize(k, k);
    for (Eigen::Index i = 0; i < k; ++i)
      normal.G.row(i) = dictionary_.gram(normal.columns[i])(normal.columns).transpose();
    normal.g = dictionary_.scores()(normal.columns);
    normal.G.diagonal() += ridge_of(blocks);
    return normal;
  }

  /// From a set to larger ones, by the likeliest name at a time, while that is worth its prior: a curve may be what several names do
  /// together, and none of these alone is as good.
  void climb_by_names(const std::vector<int>& blocks) {
    LinearSet here = evaluated(blocks);
    while (std::optional<LinearSet> next = add_to(here.blocks)) {
      if (!(next->log_posterior > here.log_posterior)) return;
      here = std::move(*next);
    }
  }

  /// Pairs of names that are added at once: none, those of which one may hide the other, or all.
  enum class Pairs { none, hidden, all };

  /// Adds to the set, drops from it, and exchanges each of its members, a curve also for two names (`splits`): it may be what both do
  /// together, and with one of them alone the set may be far from the best.
  void look_at(const std::vector<int>& blocks, bool pairs, bool splits) {
    add_to(blocks, pairs ? Pairs::hidden : Pairs::none);
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      std::vector<int> rest = blocks;
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
      keep(evaluated(rest));
      add_to(rest, splits && is_curve(blocks[i]) ? Pairs::all : Pairs::none);
    }
  }

  /// Per member its best block beside a set: gain [nats], of a curve less the cost of its size and choice; number of the block.
  using Additions = std::map<std::string, std::pair<double, int>>;

  /// Adds the pairs of names that gain most together, of hidden ones those that gain more than `hidden` beyond the sum of their single
  /// gains. `half`, `left`: of `add_to`.
  void add_pairs(const std::vector<int>& blocks, Pairs which, const Additions& best,
                 const Eigen::MatrixXd& half, const Eigen::VectorXd& left) {
    std::vector<std::pair<double, int>> names;
    for (const auto& [id, found] : best)
      if (block(found.second).tau == 0.0) names.push_back(found);
    const auto information = [&](const Block& a, const Block& b) {
      Eigen::MatrixXd I(a.size, b.size);
      for (int c = 0; c < a.size; ++c)
        I.row(c) = dictionary_.gram(a.first + c).segment(b.first, b.size).transpose();
      if (half.size() > 0)
        I -= half.middleCols(a.first, a.size).transpose() * half.middleCols(b.first, b.size);
      return I;
    };
    std::vector<std::pair<double, std::vector<int>>> pairs;  // by their gain
    for (std::size_t i = 0; i < names.size(); ++i)
      for (std::size_t j = i + 1; j < names.size(); ++j) {
        const Block &a = block(names[i].second), &b = block(names[j].second);
        Eigen::MatrixXd I(a.size + b.size, a.size + b.size);
        I << information(a, a), information(a, b), information(b, a), information(b, b);
        const Eigen::LDLT<Eigen::MatrixXd> of_a(I.topLeftCorner(a.size, a.size));
        const Eigen::MatrixXd taken =
            I.bottomLeftCorner(b.size, a.size) * of_a.solve(I.topRightCorner(a.size, b.size));
        const Eigen::VectorXd own = I.diagonal().tail(b.size);
        if (is_spanned(own - taken.diagonal(), own)) continue;
        I.diagonal() += ridge_of({names[i].second, names[j].second});
        Eigen::VectorXd g(a.size + b.size);
        g << left.segment(a.first, a.size), left.segment(b.first, b.size);
        const Eigen::LLT<Eigen::MatrixXd> factor(I);
        if (factor.info() != Eigen::Success) continue;
        const double gain = 0.5 * factor.matrixL().solve(g).squaredNorm();
        if (which == Pairs::all || gain > names[i].first + names[j].first + hidden)
          pairs.push_back({gain, {names[i].second, names[j].second}});
      }
    std::stable_sort(pairs.begin(), pairs.end(),
                     [](const auto& a, const auto& b) { return a.first > b.first; });
    for (std::size_t i = 0; i < pairs.size() && i < branches; ++i) {
      std::vector<int> larger = blocks;
      larger.insert(larger.end(), pairs[i].second.begin(), pairs[i].second.end());
      keep(evaluated(larger));
    }
  }

  /// Keeps the likeliest sets with one member more, and with such pairs of names. Returns the likeliest with one name more.
  std::optional<LinearSet> add_to(const std::vector<int>& blocks, Pairs pairs = Pairs::none) {
    const Key has = key_of(blocks);
    const Normal mine = normal_of(blocks);
    const auto k = static_cast<Eigen::Index>(mine.columns.size());
    Eigen::VectorXd left = dictionary_.scores();
    Eigen::MatrixXd half;  // L^-1 G_S*, G = L L^T
    if (k > 0) {
      const Eigen::LLT<Eigen::MatrixXd> factor(mine.G);
      if (factor.info() != Eigen::Success) return std::nullopt;
      Eigen::MatrixXd across(k, left.size());
      for (Eigen::Index i = 0; i < k; ++i) across.row(i) = dictionary_.gram(mine.columns[i]).transpose();
      half = factor.matrixL().solve(across);
      const Eigen::VectorXd half_g = factor.matrixL().solve(mine.g);
      left -= half.transpose() * half_g;
    }
    Additions best;
    for (std::size_t b = 0; b < dictionary_.blocks().size(); ++b) {
      const Block& add = dictionary_.blocks()[b];
      if (std::binary_search(has.begin(), has.end(), add.member)) continue;
      Eigen::MatrixXd information = dictionary_.own(b);
      const Eigen::VectorXd diagonal = information.diagonal();
      if (k > 0) {
        const auto part = half.middleCols(add.first, add.size);
        information -= part.transpose() * part;
      }
      double choosing = 0.0;  // what the size of a curve takes off its gain
      if (add.tau > 0.0) {
        const Eigen::MatrixXd prior = Eigen::MatrixXd::Identity(add.size, add.size);
        const Eigen::LLT<Eigen::MatrixXd> ratio(prior + add.tau * add.tau * information);
        if (ratio.info() != Eigen::Success) continue;
        const Eigen::MatrixXd L = ratio.matrixL();
        choosing = L.diagonal().array().log().sum() + std::log(add.choices);
      } else if (is_spanned(information.diagonal(), diagonal))
        continue;
      for (int c = 0; c < add.size; ++c)
        information(c, c) += ridge_of(add, add.parameters[static_cast<std::size_t>(c)]);
      const Eigen::LLT<Eigen::MatrixXd> factor(information);
      if (factor.info() != Eigen::Success) continue;
      const double gain =
          0.5 * factor.matrixL().solve(left.segment(add.first, add.size)).squaredNorm() - choosing;
      auto [entry, fresh] = best.try_emplace(add.member, gain, static_cast<int>(b));
      if (!fresh && gain > entry->second.first) entry->second = {gain, static_cast<int>(b)};
    }
    if (pairs != Pairs::none) add_pairs(blocks, pairs, best, half, left);
    std::vector<LinearSet> made;
    for (const auto& [id, found] : best) {
      if (!(found.first > 2.0)) continue;
      std::vector<int> larger = blocks;
      larger.push_back(found.second);
      made.push_back(evaluated(larger));
    }
    std::stable_sort(made.begin(), made.end(), [](const LinearSet& a, const LinearSet& b) {
      return a.log_posterior > b.log_posterior;
    });
    std::optional<LinearSet> named;
    for (const LinearSet& set : made)
      if (!named && names_in(set.blocks) > names_in(blocks)) named = set;
    if (made.size() > branches) made.resize(branches);
    for (LinearSet& set : made) keep(std::move(set));
    return named;
  }

  std::ptrdiff_t names_in(const std::vector<int>& blocks) const {
    return std::count_if(blocks.begin(), blocks.end(), [&](int b) { return !is_curve(b); });
  }

  /// Estimates, gain and posterior of a set.
  LinearSet evaluated(std::vector<int> blocks) {
    std::sort(blocks.begin(), blocks.end(), [&](int a, int b) { return block(a).member < block(b).member; });
    LinearSet set;
    const auto [columns, G, g] = normal_of(blocks);
    const auto k = static_cast<Eigen::Index>(columns.size());
    const Eigen::LLT<Eigen::MatrixXd> factor(G);
    const Eigen::VectorXd theta = k > 0 ? factor.solve(g).eval() : Eigen::VectorXd();
    if (k > 0 &&
        (factor.info() != Eigen::Success || !theta.allFinite())) {  // its columns are not independent
      set.log_posterior = -std::numeric_limits<double>::infinity();
      set.blocks = std::move(blocks);
      return set;
    }
    set.gain = k > 0 ? 0.5 * g.dot(theta) : 0.0;  // the priors' part included
    double volume = 0.0;
    Eigen::VectorXd wide(k);  // least precise that a parameter can be
    Eigen::Index at = 0;
    for (const int b : blocks) {
      const Block& one = block(b);
      ActiveEffect active{one.effect, one.start};
      for (const int j : one.parameters) {
        const EffectParameter& info = one.effect->info().parameters[static_cast<std::size_t>(j)];
        const auto [low, high] = one.effect->bounds(rows_.context, static_cast<std::size_t>(j));
        wide[at] = one.tau > 0.0 ? 1e3 * one.tau : prior_width(info, low, high, theta[at]);
        active.parameters[j] = theta[at];
        ++at;
      }
      volume += one.tau > 0.0
                    ? -static_cast<double>(one.parameters.size()) * (half_log_two_pi + std::log(one.tau))
                    : log_prior_density(rows_, *one.effect, one.parameters, active.parameters, priors_);
      volume -= std::log(one.choices);
      for (const int j : one.parameters) {
        const auto [low, high] = one.effect->bounds(rows_.context, static_cast<std::size_t>(j));
        active.parameters[j] = std::clamp(active.parameters[j], low, high);
      }
      set.model.push_back(std::move(active));
    }
    if (k > 0) {
      // |(G + wide^-2)^-1|
      const Eigen::MatrixXd information = wide.asDiagonal() * G * wide.asDiagonal();
      const Eigen::LLT<Eigen::MatrixXd> of_all(information + Eigen::MatrixXd::Identity(k, k));
      const Eigen::MatrixXd L = of_all.matrixL();
      volume += static_cast<double>(k) * half_log_two_pi + wide.array().log().sum() -
                L.diagonal().array().log().sum();
    }
    set.log_posterior = set.gain + volume + log_prior_mass(set.model, 0, counts_, priors_);
    set.blocks = std::move(blocks);
    return set;
  }

  const Rows& rows_;
  Dictionary& dictionary_;
  const MemberCounts& counts_;
  const SelectionPriors& priors_;
  std::map<Key, LinearSet> sets_;
  std::set<Key> looked_;
};

}  // namespace

std::vector<LinearSet> search_linear(const Rows& rows, Dictionary& dictionary, const Model& start,
                                     const MemberCounts& counts, const SelectionPriors& priors) {
  return LinearSearch(rows, dictionary, counts, priors).run(start);
}

}  // namespace rangecal::diagnosis
