// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/dictionary.hpp"

#include <algorithm>
#include <utility>

#include "diagnosis/candidates.hpp"
#include "diagnosis/select/hypothesis.hpp"
#include "in_parallel.hpp"

namespace rangecal::diagnosis {
namespace {

/// Part of a column's information that the calibration has to leave of it.
constexpr double least_left = 1e-5;

/// Parameters that the readings are linear in; where there are none, all that move.
std::vector<int> columns_of(const Effect& effect) {
  std::vector<int> linear, moving;
  const auto& parameters = effect.info().parameters;
  for (int j = 0; j < static_cast<int>(parameters.size()); ++j) {
    if (parameters[j].discrete) continue;
    moving.push_back(j);
    if (parameters[j].linear) linear.push_back(j);
  }
  return linear.empty() ? moving : linear;
}

const CurvePlace* place_of(const Effect* effect, const std::vector<CurvePlace>& curves) {
  for (const CurvePlace& curve : curves)
    if (curve.effect.get() == effect) return &curve;
  return nullptr;
}

struct Made {
  Block block;
  std::vector<Signature> signatures;
  std::vector<Eigen::VectorXd> projected;
  Eigen::MatrixXd own;
};

/// The columns of one block that the calibration does not absorb.
Made made_of(const Rows& rows, const Projector& projector, const Effect& effect, const Eigen::VectorXd& start,
             const std::vector<int>& parameters) {
  Made made;
  made.block.effect = &effect;
  made.block.member = member_name(effect);
  made.block.start = start;
  for (const int j : parameters) {
    Signature x = effect_signature(rows, projector, {&effect, start}, j);
    const double raw = projector.raw_information(x);
    if (!(raw > 0.0)) continue;
    Eigen::VectorXd projected = projector.project(x);
    if (!(projector.inner(x, projected, x) > least_left * raw)) continue;
    made.block.parameters.push_back(j);
    made.signatures.push_back(std::move(x));
    made.projected.push_back(std::move(projected));
  }
  made.block.size = static_cast<int>(made.signatures.size());
  made.own.resize(made.block.size, made.block.size);
  for (int a = 0; a < made.block.size; ++a)
    for (int b = 0; b <= a; ++b)
      made.own(a, b) = made.own(b, a) =
          projector.inner(made.signatures[a], made.projected[b], made.signatures[b]);
  return made;
}

}  // namespace

Dictionary::Dictionary(const Rows& rows, const Fit& fit, const std::vector<CurvePlace>& curves)
    : working_(working_problem(rows, fit.model, fit.state)), projector_(rows, working_, fit.state) {
  struct Wanted {
    const Effect* effect;
    Eigen::VectorXd start;
    bool of_fit;
    const CurvePlace* curve;
    double choices;
  };
  std::vector<Wanted> wanted;
  for (const ActiveEffect& active : fit.model)
    if (active.effect->info().kind == EffectKind::mean)
      wanted.push_back({active.effect, active.parameters, true, place_of(active.effect, curves),
                        static_cast<double>(active.effect->start_grid(rows.context).size())});
  for (const auto& effect : effect_registry()) {
    if (effect->info().kind != EffectKind::mean || !effect->missing(rows.context).empty()) continue;
    const std::vector<Eigen::VectorXd> grid = effect->start_grid(rows.context);
    for (const Eigen::VectorXd& start : grid)
      wanted.push_back({effect.get(), start, false, nullptr, static_cast<double>(grid.size())});
  }
  for (const CurvePlace& curve : curves) {
    const auto size = static_cast<Eigen::Index>(curve.effect->info().parameters.size());
    if (contains(fit.model, curve.effect.get())) continue;
    wanted.push_back({curve.effect.get(), Eigen::VectorXd::Zero(size), false, &curve, 1.0});
  }
  std::vector<Made> made(wanted.size());
  constexpr std::size_t together = 16;
  in_parallel((wanted.size() + together - 1) / together, [&](std::size_t part) {
    for (std::size_t i = part * together; i < std::min(wanted.size(), (part + 1) * together); ++i)
      made[i] = made_of(rows, projector_, *wanted[i].effect, wanted[i].start, columns_of(*wanted[i].effect));
  });
  std::vector<std::pair<int, double>> put_back;  // columns of the fit's own effects, and their parameters
  for (std::size_t i = 0; i < made.size(); ++i) {
    Block& block = made[i].block;
    if (block.size == 0) continue;
    block.first = static_cast<int>(signatures_.size());
    if (wanted[i].of_fit)
      for (int c = 0; c < block.size; ++c)
        put_back.emplace_back(block.first + c, block.start[block.parameters[static_cast<std::size_t>(c)]]);
    std::move(made[i].signatures.begin(), made[i].signatures.end(), std::back_inserter(signatures_));
    std::move(made[i].projected.begin(), made[i].projected.end(), std::back_inserter(projected_));
    const CurvePlace* curve = wanted[i].curve;
    block.choices = curve ? curve->effect->choices : std::max(1.0, wanted[i].choices);
    for (std::size_t n = 0; n < (curve ? curve->sizes.size() : 1); ++n) {
      blocks_.push_back(block);
      if (curve) blocks_.back().tau = curve->sizes[n];
      own_.push_back(made[i].own);
    }
  }
  scores_.resize(static_cast<Eigen::Index>(signatures_.size()));
  for (Eigen::Index i = 0; i < scores_.size(); ++i)
    scores_[i] = projector_.score(signatures_[static_cast<std::size_t>(i)]);
  for (const auto& [column, parameter] : put_back) scores_ += parameter * gram(column);
}

const Eigen::VectorXd& Dictionary::gram(int column) {
  const auto known = gram_.find(column);
  if (known != gram_.end()) return known->second;
  Eigen::VectorXd row(static_cast<Eigen::Index>(signatures_.size()));
  const auto j = static_cast<std::size_t>(column);
  for (std::size_t i = 0; i < signatures_.size(); ++i)
    row[static_cast<Eigen::Index>(i)] = projector_.inner(signatures_[i], projected_[j], signatures_[j]);
  return gram_.emplace(column, std::move(row)).first->second;
}

}  // namespace rangecal::diagnosis
