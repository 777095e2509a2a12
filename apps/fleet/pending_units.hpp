// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "fleet/database.hpp"
#include "rangecal/core/work_queue.hpp"

namespace rangecal::app {

/// Which units of the table `inputs` (`name`, `identity`) a run works at: of a shard every n-th, or those that it takes from a queue
/// that it shares with others.
struct UnitShare {
  int shard = 0, shards = 1;  ///< of the units, counted over their names in order
  /// Gives the queue of so many units (`work`: a number of its own for each list of names), once the inputs are known; null: all is done
  /// by others. Empty: there is none.
  std::function<WorkQueue*(std::int64_t units, std::uint64_t work)> queue;

  bool partial() const { return shards > 1 || queue; }
};

/// The units that have no row in a table yet, batch by batch. A batch is what one transaction takes: as many as there are
/// threads at first, twice as many after each that was quick, 256 at most.
class PendingUnits {
 public:
  struct One {
    std::string name, identity;
  };

  /// `table` has the column `name`.
  PendingUnits(Database& database, std::string table, const UnitShare& share);

  /// Empty: nothing is left to do. Of a queue the batch before has to be done.
  std::vector<One> next();
  /// The rows of the batch are kept.
  void done();

 private:
  std::vector<One> next_of_shard();
  std::vector<One> next_of_queue();

  Database& database_;
  std::string table_;
  const UnitShare& share_;
  WorkQueue* queue_ = nullptr;
  std::vector<std::int64_t> taken_;
  std::string after_;
  std::int64_t index_ = -1;
  std::size_t batch_;
  std::optional<std::chrono::steady_clock::time_point> begun_;  ///< the last batch
};

}  // namespace rangecal::app
