// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/solvers/study/bound.hpp"
#include "rangecal/solvers/study/sums.hpp"

namespace rangecal {

/// Consecutive repeats of one point, done as one piece: what is handed out, written down and added up. Pieces are cut
/// by the study alone and added in their order, so that every way to run a study gives the same bits.
struct StudyUnit {
  int point = 0, piece = 0;
  bool operator==(const StudyUnit&) const = default;
};
int study_pieces(const Study& study);  ///< of every point
int study_unit_repeats(const Study& study,
                       const StudyUnit& unit);  ///< Study::piece, or what is left for the last one

/// The sums of one unit. Any thread or process may run any unit. Throws InputError where the scene cannot be
/// simulated.
StudySums run_study_unit(const Study& study, const StudyUnit& unit);

/// A point whose repeats are all in.
struct StudyPointResult {
  int point = 0;
  StudySums sums;
  std::optional<StudyBound> bound;
};

struct StudyOptions {
  int threads = 0;            ///< 0: all cores
  int shard = 0, shards = 1;  ///< runs the units whose running number leaves `shard` on division by `shards`
  /// Sums from an earlier run; none for a unit still to do. Asked once per unit when its turn to be added comes.
  std::function<std::optional<StudySums>(const StudyUnit&)> recall;
  std::function<bool(const StudyUnit&)> is_known;  ///< whether `recall` has it
  /// Told of every unit that ran, in the order of finishing, one at a time.
  std::function<void(const StudyUnit&, const StudySums&)> on_unit;
  /// Told of every point that is complete, one at a time, in any order, and while `on_unit` may be told of units of other
  /// points; with shards only of those that this run completes.
  std::function<void(const StudyPointResult&)> on_point;
};

/// The units of a study, handed out in order and added up in order. Safe to use from several threads. Holds the
/// sums of points begun and of units that finished before their turn: its memory does not grow with the repeats.
class StudyWork {
 public:
  StudyWork(const Study& study, StudyOptions options);

  std::optional<StudyUnit> next();  ///< none: all are handed out, or the work was stopped
  void stop();  ///< no more are handed out: what was told of one has thrown, or it cannot be run
  void done(const StudyUnit& unit, StudySums sums);
  long units_to_do() const { return to_do_; }  ///< that were not known at the start
  long units_done() const { return done_; }    ///< of these
  int points_complete() const { return complete_; }

 private:
  struct Open {
    int next = 0;
    StudySums sums;
    std::map<int, StudySums> early;  ///< finished before their turn
  };
  bool known(const StudyUnit& unit) const { return options_.is_known && options_.is_known(unit); }
  bool mine(const StudyUnit& unit) const;
  std::optional<StudyPointResult> advance(int point);
  void tell(StudyPointResult result);

  const Study& study_;
  StudyOptions options_;
  std::mutex mutex_, telling_;
  std::map<int, Open> open_;
  long cursor_ = 0, to_do_ = 0, done_ = 0;
  int pieces_ = 0, complete_ = 0;
  bool stopped_ = false;
};

/// Runs what is not known yet, on threads of this process (oneTBB). Everything is told through the callbacks. Throws what a
/// unit or a callback throws; the other threads then end the units they are at, and begin no more.
void run_study(const Study& study, const StudyOptions& options);

/// The same kept in memory: one result per point.
std::vector<StudyPointResult> run_study(const Study& study, int threads = 0);

}  // namespace rangecal
