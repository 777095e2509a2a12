// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/pending_units.hpp"

#include <fmt/format.h>
#include <tbb/global_control.h>

#include <algorithm>

#include "rangecal/core/random.hpp"

namespace rangecal::app {

PendingUnits::PendingUnits(Database& database, std::string table, const UnitShare& share)
    : database_(database),
      table_(std::move(table)),
      share_(share),
      batch_(tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism)) {
  if (!share.queue) return;
  // A unit's number in the queue is its row here.
  database.execute(
      "CREATE TEMP TABLE numbered(number INTEGER PRIMARY KEY, name TEXT, identity TEXT);"
      "INSERT INTO numbered(name, identity) SELECT name, identity FROM inputs ORDER BY name");
  std::uint64_t work = 0;
  std::int64_t units = 0;
  Statement names = database.prepare("SELECT name FROM numbered ORDER BY number");
  for (; names.step(); ++units) work = seed_from(names.text(0), {work});
  queue_ = share.queue(units, work);
}

std::vector<PendingUnits::One> PendingUnits::next() {
  using namespace std::chrono_literals;
  constexpr std::size_t most = 256;
  if (begun_ && std::chrono::steady_clock::now() - *begun_ < 250ms) batch_ = std::min(most, 2 * batch_);
  std::vector<One> units = share_.queue ? next_of_queue() : next_of_shard();
  begun_ = std::chrono::steady_clock::now();
  return units;
}

std::vector<PendingUnits::One> PendingUnits::next_of_shard() {
  std::vector<One> units;
  Statement names = database_.prepare(
      fmt::format("SELECT inputs.name, {0}.name IS NOT NULL, identity FROM inputs LEFT JOIN {0} USING(name)"
                  " WHERE inputs.name > ? ORDER BY inputs.name",
                  table_));
  names.bind(1, after_);
  while (units.size() < batch_ && names.step()) {
    after_ = names.text(0);
    ++index_;
    if (index_ % share_.shards != share_.shard || names.integer(1) != 0) continue;
    units.push_back({after_, names.text(2)});
  }
  return units;
}

std::vector<PendingUnits::One> PendingUnits::next_of_queue() {
  std::vector<One> units;
  while (queue_ && units.empty()) {
    taken_ = queue_->take(batch_);
    if (taken_.empty()) break;
    Statement row =
        database_.prepare(fmt::format("SELECT n.name, n.identity FROM numbered n LEFT JOIN {} t USING(name)"
                                      " WHERE n.number = ? AND t.name IS NULL",
                                      table_));
    for (const std::int64_t number : taken_) {
      row.bind(1, number + 1);
      if (row.step()) units.push_back({row.text(0), row.text(1)});
      row.run();
    }
    if (units.empty()) done();  // all of them were done by a run before
  }
  return units;
}

void PendingUnits::done() {
  if (queue_) queue_->done(taken_);
  taken_.clear();
}

}  // namespace rangecal::app
