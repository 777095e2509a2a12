// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/study/run.hpp"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <utility>

namespace rangecal {

int study_pieces(const Study& study) { return (study.repeats - 1) / study.piece + 1; }

int study_unit_repeats(const Study& study, const StudyUnit& unit) {
  return std::min(study.piece, study.repeats - unit.piece * study.piece);
}

StudySums run_study_unit(const Study& study, const StudyUnit& unit) {
  const StudyPoint& point = study.points[unit.point];
  const StudyLayout layout(study, point);
  StudySums sums;
  sums.prepare(layout);
  const int first = unit.piece * study.piece, count = study_unit_repeats(study, unit);
  for (int repeat = first; repeat < first + count; ++repeat)
    run_study_repeat(study, point, layout, repeat, sums);
  return sums;
}

StudyWork::StudyWork(const Study& study, StudyOptions options)
    : study_(study), options_(std::move(options)), pieces_(study_pieces(study)) {
  const auto points = static_cast<int>(study.points.size());
  for (int p = 0; p < points; ++p)
    for (int c = 0; c < pieces_; ++c) to_do_ += mine({p, c}) && !known({p, c});
  for (int p = 0; p < points; ++p)
    if (auto complete = advance(p)) tell(std::move(*complete));
}

bool StudyWork::mine(const StudyUnit& unit) const {
  return (static_cast<long>(unit.point) * pieces_ + unit.piece) % options_.shards == options_.shard;
}

std::optional<StudyUnit> StudyWork::next() {
  const std::lock_guard lock(mutex_);
  const long all = static_cast<long>(study_.points.size()) * pieces_;
  while (!stopped_ && cursor_ < all) {
    const StudyUnit unit{static_cast<int>(cursor_ / pieces_), static_cast<int>(cursor_ % pieces_)};
    ++cursor_;
    if (mine(unit) && !known(unit)) return unit;
  }
  return std::nullopt;
}

void StudyWork::stop() {
  const std::lock_guard lock(mutex_);
  stopped_ = true;
}

void StudyWork::done(const StudyUnit& unit, StudySums sums) {
  std::optional<StudyPointResult> complete;
  {
    const std::lock_guard lock(mutex_);
    if (options_.on_unit) options_.on_unit(unit, sums);
    ++done_;
    if (options_.shards > 1)
      return;  // the others' units are missing: the points come when all shards are together
    open_[unit.point].early.emplace(unit.piece, std::move(sums));
    complete = advance(unit.point);
  }
  if (complete) tell(std::move(*complete));
}

/// Adds to the point all units whose turn has come; the point, if these were the last.
std::optional<StudyPointResult> StudyWork::advance(int point) {
  if (options_.shards > 1) return std::nullopt;
  const auto begun = open_.find(point);
  if (begun == open_.end() && !known({point, 0})) return std::nullopt;
  Open& open = begun == open_.end() ? open_[point] : begun->second;
  if (open.sums.numbers.empty()) open.sums.prepare(StudyLayout(study_, study_.points[point]));
  for (; open.next < pieces_; ++open.next) {
    const auto early = open.early.find(open.next);
    if (early != open.early.end()) {
      open.sums.add(early->second);
      open.early.erase(early);
    } else if (known({point, open.next})) {
      open.sums.add(options_.recall({point, open.next}).value());
    } else {
      return std::nullopt;
    }
  }
  ++complete_;
  StudyPointResult result{point, std::move(open.sums), std::nullopt};
  open_.erase(point);
  return result;
}

/// The bound and what is made of a point depend on that point alone: meanwhile the other units go on.
void StudyWork::tell(StudyPointResult result) {
  if (!options_.on_point) return;
  if (study_.measures_any({StudyMeasure::rmse_over_bound}))
    result.bound = study_bound(study_, study_.points[result.point]);
  const std::lock_guard lock(telling_);
  options_.on_point(result);
}

void run_study(const Study& study, const StudyOptions& options) {
  StudyWork work(study, options);
  const int threads = options.threads > 0 ? options.threads : tbb::this_task_arena::max_concurrency();
  const tbb::global_control allowed(tbb::global_control::max_allowed_parallelism,
                                    std::max<std::size_t>(threads, tbb::this_task_arena::max_concurrency()));
  tbb::task_arena arena(threads);
  arena.execute([&] {
    tbb::task_group group;
    for (int t = 0; t < threads; ++t)
      group.run([&] {
        try {
          while (const auto unit = work.next()) work.done(*unit, run_study_unit(study, *unit));
        } catch (...) {
          work.stop();
          throw;
        }
      });
    group.wait();
  });
}

std::vector<StudyPointResult> run_study(const Study& study, int threads) {
  std::vector<StudyPointResult> results(study.points.size());
  StudyOptions options;
  options.threads = threads;
  options.on_point = [&](const StudyPointResult& result) { results[result.point] = result; };
  run_study(study, options);
  return results;
}

}  // namespace rangecal
