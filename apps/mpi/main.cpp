// SPDX-License-Identifier: BSD-3-Clause
// `rangecal study`, `fleet` and `diagnose --each` under mpirun: a program of its own, so that no other command needs MPI to start.
// Recordings are shared by a queue in a file (mpi/ranks.hpp). Of a study rank 0 owns the folder and hands units out, one per question, so that
// slow ranks simply ask less often; it computes too. Results travel as the lines of the journal, which give back the same bits.
#include <fmt/core.h>
#include <mpi.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <exception>
#include <optional>
#include <string>
#include <thread>

#include "commands.hpp"
#include "each/each_job.hpp"
#include "fleet/command.hpp"
#include "logging.hpp"
#include "mpi/ranks.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/problems/effects/formula_effect.hpp"
#include "study/command.hpp"

namespace {

using namespace rangecal;
using namespace rangecal::app;

enum Tag { asks = 1, answers = 2, unit_follows = 3, fails = 4 };

struct World {
  int rank = 0, size = 1;
};

void send_text(const std::string& text, int to, Tag tag) {
  MPI_Send(text.data(), static_cast<int>(text.size()), MPI_CHAR, to, tag, MPI_COMM_WORLD);
}

/// A rank other than 0: asks, computes, sends the line back, until there is nothing left.
void compute(const Study& study) {
  send_text("", 0, asks);
  for (;;) {
    std::array<int, 2> numbers{};
    MPI_Recv(numbers.data(), 2, MPI_INT, 0, unit_follows, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
    if (numbers[0] < 0) return;
    const StudyUnit unit{numbers[0], numbers[1]};
    try {
      send_text(journal_line(unit, run_study_unit(study, unit)), 0, answers);
    } catch (const std::exception& error) {
      send_text(error.what(), 0, fails);
    }
  }
}

/// Rank 0: one thread computes, this one answers the other ranks.
void hand_out(const Study& study, StudyWork& work, const World& world) {
  std::exception_ptr failed;
  std::atomic<bool> stop{false}, computing{true};
  std::string other_failed;
  std::thread own([&] {
    try {
      while (!stop) {
        const auto unit = work.next();
        if (!unit) break;
        work.done(*unit, run_study_unit(study, *unit));
      }
    } catch (...) {
      failed = std::current_exception();
      stop = true;
    }
    computing = false;
  });
  std::string text;
  for (int active = world.size - 1; active > 0;) {
    int there = 0;
    MPI_Status status;
    MPI_Iprobe(MPI_ANY_SOURCE, MPI_ANY_TAG, MPI_COMM_WORLD, &there, &status);
    if (!there) {  // waiting inside MPI would take the core from the thread that computes
      std::this_thread::sleep_for(std::chrono::microseconds(computing ? 100 : 20));
      continue;
    }
    int length = 0;
    MPI_Get_count(&status, MPI_CHAR, &length);
    text.resize(static_cast<std::size_t>(length));
    MPI_Recv(text.data(), length, MPI_CHAR, status.MPI_SOURCE, status.MPI_TAG, MPI_COMM_WORLD,
             MPI_STATUS_IGNORE);
    std::optional<StudyUnit> next;
    try {
      if (status.MPI_TAG == answers) {
        auto parsed = from_journal_line(text);
        if (!parsed) throw std::runtime_error("a rank sent a damaged line");
        work.done(parsed->first, std::move(parsed->second));
      } else if (status.MPI_TAG == fails) {
        other_failed = text;
        stop = true;
      }
      if (!stop) next = work.next();
    } catch (...) {
      if (!failed) failed = std::current_exception();
      stop = true;
    }
    const std::array<int, 2> numbers =
        next ? std::array<int, 2>{next->point, next->piece} : std::array<int, 2>{-1, -1};
    active -= !next;
    MPI_Send(numbers.data(), 2, MPI_INT, status.MPI_SOURCE, unit_follows, MPI_COMM_WORLD);
  }
  own.join();
  if (failed) std::rethrow_exception(failed);
  if (!other_failed.empty()) throw InputError(other_failed);
}

void complain(const std::string& what) { fmt::print(stderr, "rangecal: {}\n", what); }

/// True on every rank if it is on all; where rank 0 is fine and another is not, rank 0 says which.
bool all_agree(bool fine, const World& world) {
  const int mine = fine ? world.size : world.rank;
  int worst = 0;
  MPI_Allreduce(&mine, &worst, 1, MPI_INT, MPI_MIN, MPI_COMM_WORLD);
  if (worst < world.size && worst > 0 && world.rank == 0)
    complain(fmt::format("rank {} does not read the same study; is the file on every machine?", worst));
  return worst == world.size;
}

int run(StudyJob& job, const World& world) {
  std::optional<Study> study;
  try {
    study = study_of(job);
  } catch (const std::exception& error) {
    if (world.rank == 0) complain(error.what());
  }
  std::uint64_t print = study ? study->fingerprint : 0;
  MPI_Bcast(&print, 1, MPI_UINT64_T, 0, MPI_COMM_WORLD);
  if (!all_agree(study && study->fingerprint == print, world)) return bad_input;

  std::optional<StudyFolder> folder;
  std::optional<StudyWork> work;
  try {
    if (world.rank == 0) {
      folder.emplace(*study, job);
      work.emplace(*study, folder->options());
    }
  } catch (const std::exception& error) {
    complain(error.what());
  }
  if (!all_agree(world.rank > 0 || work.has_value(), world)) return bad_input;
  if (world.rank > 0) {
    compute(*study);
    return done;
  }
  try {
    hand_out(*study, *work, world);
  } catch (const InputError& error) {
    complain(error.what());
    return bad_input;
  }
  return folder->finish();
}

RankedWork work_of(FleetCommand& given) {
  FleetJob& job = given.job;
  RankedWork work;
  work.output = job.output;
  work.prepare = [&] {
    given.prepare();
    if (!given.shard.empty() || !job.merge.empty())
      throw InputError("--shard and --merge are for runs without mpirun");
  };
  work.work = [&](const UnitShare& share, const std::string& part) {
    FleetJob own = job;
    own.output = part, own.csv.clear();
    own.share = share;
    own.threads = std::max(1, job.threads);  // the other ranks may stand on the same machine
    run_fleet(own);
  };
  work.finish = [&](const std::vector<std::string>& parts) {
    if (!parts.empty()) job.inputs.clear();
    job.merge = parts;
    return given.deliver(run_fleet(job));
  };
  return work;
}

RankedWork work_of(EachJob& job) {
  RankedWork work;
  work.output = job.output;
  work.prepare = [&] { job.check(); };
  work.work = [&](const UnitShare& share, const std::string& part) {
    EachJob own = job;
    own.output = part, own.page.clear();
    own.share = share;
    own.threads = std::max(1, job.threads);
    run_each(own);
  };
  work.finish = [&](const std::vector<std::string>& parts) {
    if (!parts.empty()) job.inputs.clear();
    job.merge = parts;
    const EachResult result = run_each(job);
    fmt::print("{}", describe(job, result));
    for (const std::string& note : result.notes) complain(note);
    return int{done};
  };
  return work;
}

/// `diagnose` as `rangecal` hands it over: with what --each takes.
CLI::App* declare_each(CLI::App& app, EachJob& job) {
  CLI::App* command = app.add_subcommand("diagnose", "every recording for itself");
  command->add_option("REC", job.inputs)->required();
  job.add_to(*command);
  command->add_option("--alarm-rate", job.alarm_rate);
  command->add_option("--curve", job.curve);
  command->add_option("--force", job.force)->delimiter(',');
  command->add_option("--without", job.without)->delimiter(',');
  command->add_option("--group-by", job.group_by)->delimiter(',');
  command->add_option("--effects")->each([](const std::string& folder) { add_effects_by_formula(folder); });
  return command;
}

}  // namespace

int main(int argc, char** argv) {
  std::signal(SIGXFSZ, SIG_IGN);  // as in rangecal itself
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  World world;
  MPI_Comm_rank(MPI_COMM_WORLD, &world.rank);
  MPI_Comm_size(MPI_COMM_WORLD, &world.size);
  CLI::App app{"rangecal under mpirun"};
  app.require_subcommand(1);
  StudyJob job;
  declare_study(app, job);
  FleetCommand fleet;
  const CLI::App* fleets = declare_fleet(app, fleet);
  EachJob each;
  const CLI::App* diagnoses = declare_each(app, each);
  Logging logging;
  logging.add_to(app);
  int code = bad_input;
  try {
    app.parse(argc, argv);
    logging.start(argv[0]);
    if (fleets->parsed())
      code = run_on_ranks(work_of(fleet), world.rank, world.size);
    else if (diagnoses->parsed())
      code = run_on_ranks(work_of(each), world.rank, world.size);
    else
      code = run(job, world);
  } catch (const CLI::ParseError& error) {
    if (world.rank == 0) code = app.exit(error) == 0 ? done : bad_input;
  } catch (const std::exception& error) {  // the others wait: only ending all of them ends the run
    complain(std::string("internal error: ") + error.what());
    int ended = 0;
    MPI_Finalized(&ended);
    if (!ended) MPI_Abort(MPI_COMM_WORLD, not_delivered);
    return not_delivered;
  }
  int ended = 0;
  MPI_Finalized(&ended);
  if (!ended) MPI_Finalize();
  return code;
}
