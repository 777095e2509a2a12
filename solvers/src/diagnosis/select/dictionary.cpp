// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/dictionary.hpp"

#include <algorithm>
#include <utility>

#include "diagnosis/candidates.hpp"
#include "diagnosis/select/hypothesis.hpp"
#include "in_parallel.hpp"

namespace rangecal::diagnosis {
namespace {

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

}  // namespace

/// The columns of one block that the calibration does not absorb.
struct Dictionary::Made {
  Block block;
  std::vector<double> scores;
  std::vector<Within> within;  ///< columns counted from the block's first
  Eigen::MatrixXd own;
};

Dictionary::Made Dictionary::made_of(const Effect& effect, const Eigen::VectorXd& start,
                                     const std::vector<int>& parameters,
                                     Eigen::Ref<Eigen::MatrixXd> columns) const {
  Made made;
  made.block.effect = &effect;
  made.block.member = member_name(effect);
  made.block.start = start;
  std::vector<Signature> signatures;
  std::vector<Eigen::VectorXd> projected;
  for (const int j : parameters) {
    Signature x = effect_signature(rows_, projector_, {&effect, start}, j);
    Eigen::VectorXd px = projector_.project(x);
    if (!(projector_.inner(x, px, x) > projector_.least_information(x))) continue;
    const auto c = static_cast<Eigen::Index>(signatures.size());
    columns.col(c).head(rows_.cell_count) = x.range;
    if (!rows_.pairs) columns.col(c).tail(rows_.cell_count) = x.bearing;
    if (x.within()) {
      Within of_rows{static_cast<int>(c), {}, {}};
      if (!x.range_rows.isZero(0.0))
        of_rows.range = x.range_rows.cwiseProduct(projector_.row_range_information.cwiseSqrt());
      if (!rows_.pairs && !x.bearing_rows.isZero(0.0))
        of_rows.bearing = x.bearing_rows.cwiseProduct(projector_.row_bearing_information.cwiseSqrt());
      made.within.push_back(std::move(of_rows));
    }
    made.scores.push_back(projector_.score(x));
    made.block.parameters.push_back(j);
    signatures.push_back(std::move(x));
    projected.push_back(std::move(px));
  }
  made.block.size = static_cast<int>(signatures.size());
  made.own.resize(made.block.size, made.block.size);
  for (int a = 0; a < made.block.size; ++a)
    for (int b = 0; b <= a; ++b)
      made.own(a, b) = made.own(b, a) = projector_.inner(signatures[a], projected[b], signatures[b]);
  return made;
}

Dictionary::Dictionary(const Rows& rows, const Fit& fit, const std::vector<CurvePlace>& curves)
    : rows_(rows),
      working_(working_problem(rows, fit.model, fit.state)),
      projector_(rows, working_, fit.state) {
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
  for (const Effect* effect : effects_of(rows.context)) {
    if (effect->info().kind != EffectKind::mean || !effect->lacking(rows.context).empty()) continue;
    const std::vector<Eigen::VectorXd> grid = effect->start_grid(rows.context);
    for (const Eigen::VectorXd& start : grid)
      wanted.push_back({effect, start, false, nullptr, static_cast<double>(grid.size())});
  }
  for (const CurvePlace& curve : curves) {
    const auto size = static_cast<Eigen::Index>(curve.effect->info().parameters.size());
    if (contains(fit.model, curve.effect.get())) continue;
    wanted.push_back({curve.effect.get(), Eigen::VectorXd::Zero(size), false, &curve, 1.0});
  }
  // Room for the columns of all; those that are kept move together afterwards.
  std::vector<std::vector<int>> parameters(wanted.size());
  std::vector<Eigen::Index> room{0};
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    parameters[i] = columns_of(*wanted[i].effect);
    room.push_back(room.back() + static_cast<Eigen::Index>(parameters[i].size()));
  }
  columns_.resize((rows.pairs ? 1 : 2) * rows.cell_count, room.back());
  std::vector<Made> made(wanted.size());
  constexpr std::size_t together = 16;
  in_parallel((wanted.size() + together - 1) / together, [&](std::size_t part) {
    for (std::size_t i = part * together; i < std::min(wanted.size(), (part + 1) * together); ++i)
      made[i] = made_of(*wanted[i].effect, wanted[i].start, parameters[i],
                        columns_.middleCols(room[i], room[i + 1] - room[i]));
  });
  std::vector<std::pair<int, double>> put_back;  // columns of the fit's own effects, and their parameters
  std::vector<double> scores;
  for (std::size_t i = 0; i < made.size(); ++i) {
    Block& block = made[i].block;
    if (block.size == 0) continue;
    block.first = static_cast<int>(scores.size());
    for (int c = 0; c < block.size && block.first < room[i]; ++c)
      columns_.col(block.first + c) = columns_.col(room[i] + c);
    if (wanted[i].of_fit)
      for (int c = 0; c < block.size; ++c)
        put_back.emplace_back(block.first + c, block.start[block.parameters[static_cast<std::size_t>(c)]]);
    for (Within& of_rows : made[i].within) {
      of_rows.column += block.first;
      within_.push_back(std::move(of_rows));
    }
    scores.insert(scores.end(), made[i].scores.begin(), made[i].scores.end());
    const CurvePlace* curve = wanted[i].curve;
    block.choices = curve ? curve->effect->choices : std::max(1.0, wanted[i].choices);
    for (std::size_t n = 0; n < (curve ? curve->sizes.size() : 1); ++n) {
      blocks_.push_back(block);
      if (curve) blocks_.back().tau = curve->sizes[n];
      own_.push_back(made[i].own);
    }
  }
  scores_ = Eigen::Map<const Eigen::VectorXd>(scores.data(), static_cast<Eigen::Index>(scores.size()));
  for (const auto& [column, parameter] : put_back) scores_ += parameter * gram(column);
}

const Eigen::VectorXd& Dictionary::gram(int column) {
  const auto known = gram_.find(column);
  if (known != gram_.end()) return known->second;
  add_grams_of_block(column);
  return gram_.at(column);
}

void Dictionary::add_grams_of_block(int column) {
  const auto block = std::find_if(blocks_.begin(), blocks_.end(), [&](const Block& b) {
    return b.first <= column && column < b.first + b.size;
  });
  const Eigen::Index cells = rows_.cell_count, count = scores_.size();
  Eigen::MatrixXd projected(columns_.rows(), block->size), rows(count, block->size);
  for (int c = 0; c < block->size; ++c) {
    const auto own = columns_.col(block->first + c);
    Signature x;
    x.range = own.head(cells);
    x.bearing = rows_.pairs ? Eigen::VectorXd(Eigen::VectorXd::Zero(cells)) : own.tail(cells);
    projected.col(c) = projector_.project(x).head(projected.rows());
  }
  constexpr Eigen::Index together = 256,
                         few = 3;  // columns that are not worth the packing of a matrix product
  in_parallel(static_cast<std::size_t>((count + together - 1) / together), [&](std::size_t part) {
    const Eigen::Index first = static_cast<Eigen::Index>(part) * together,
                       size = std::min(together, count - first);
    if (projected.cols() > few) {
      rows.middleRows(first, size).noalias() = columns_.middleCols(first, size).transpose() * projected;
      return;
    }
    for (Eigen::Index j = first; j < first + size; ++j)
      for (Eigen::Index c = 0; c < projected.cols(); ++c) rows(j, c) = columns_.col(j).dot(projected.col(c));
  });
  for (const Within& own : within_) {
    const int c = own.column - block->first;
    if (c < 0 || c >= block->size) continue;
    for (const Within& other : within_) {
      if (own.range.size() > 0 && other.range.size() > 0) rows(other.column, c) += other.range.dot(own.range);
      if (own.bearing.size() > 0 && other.bearing.size() > 0)
        rows(other.column, c) += other.bearing.dot(own.bearing);
    }
  }
  for (int c = 0; c < block->size; ++c) gram_.emplace(block->first + c, rows.col(c));
}

}  // namespace rangecal::diagnosis
