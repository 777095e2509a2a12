// SPDX-License-Identifier: BSD-3-Clause
#include "study/journal.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>

#include "rangecal/core/errors.hpp"
#include "support/open_files.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal::app {
namespace {

Study study_called(const std::string& name) {
  Study study;
  study.name = name;
  study.repeats = 40;
  study.points.resize(1);
  return study;
}

/// Until its end no file of this process can be longer than `bytes`: a write fails as on a full disk.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) : handler_(::signal(SIGXFSZ, SIG_IGN)) {
    ::getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit less{bytes, before_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &less);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;
  ~FullDisk() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    ::signal(SIGXFSZ, handler_);
  }

 private:
  void (*handler_)(int);
  rlimit before_{};
};

TEST(StudyJournal, AWriterThatCannotWriteHoldsNothing) {
  const test::TemporaryFolder folder;
  const Study study = study_called("a");
  const long before = test::open_files();
  EXPECT_THROW(JournalWriter(study, "/dev/full"), InputError);  // a device is not cut to its first line
  EXPECT_EQ(test::open_files(), before);
  const std::string path = folder.file("journal.txt");
  {
    const FullDisk full(3);
    EXPECT_THROW(JournalWriter(study, path), InputError);
  }
  EXPECT_EQ(test::open_files(), before);
  const JournalWriter again(study, path);  // nor its lock
  EXPECT_THROW(JournalWriter(study, path), InputError);
  EXPECT_EQ(test::open_files(), before + 1);
}

TEST(StudyJournal, AReaderThatRefusesAJournalClosesTheOthers) {
  const test::TemporaryFolder folder;
  JournalWriter(study_called("a"), folder.file("journal-1-of-2.txt"));
  JournalWriter(study_called("b"), folder.file("journal-2-of-2.txt"));
  const long before = test::open_files();
  EXPECT_THROW(JournalReader(study_called("a"), {folder.path()}), InputError);
  EXPECT_EQ(test::open_files(), before);
}

TEST(StudyJournal, GivesBackTheBitsItWasGiven) {
  const test::TemporaryFolder folder;
  const Study study = study_called("a");
  StudySums sums;
  sums.repeats = 20;
  sums.numbers = {0.1, 1.0 / 3.0, -0.0};
  sums.seconds = {1e-300};
  {
    JournalWriter writer(study, folder.file("journal.txt"));
    writer.append({0, 1}, sums);
  }
  const JournalReader reader(study, {folder.path()});
  EXPECT_EQ(reader.units(), 1u);
  const auto found = reader.recall({0, 1});
  ASSERT_TRUE(found);
  EXPECT_EQ(found->numbers, sums.numbers);
  EXPECT_EQ(found->seconds, sums.seconds);
  EXPECT_FALSE(reader.recall({0, 0}));
}

}  // namespace
}  // namespace rangecal::app
