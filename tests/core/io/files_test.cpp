// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/files.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <iterator>
#include <string>
#include <thread>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal {
namespace {

/// What is complained of; empty where nothing is.
std::string refusal_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

/// a, a hard link and a symbolic one to it, and b.
class NamedFiles : public ::testing::Test {
 protected:
  NamedFiles() {
    folder.write("a", "1");
    folder.write("b", "1");  // the same text, another file
    std::filesystem::create_symlink("a", folder.file("link"));
    std::filesystem::create_hard_link(folder.file("a"), folder.file("hard"));
  }
  const test::TemporaryFolder folder;
  const std::string a = folder.file("a"), b = folder.file("b"), gone = folder.file("gone");
};

TEST_F(NamedFiles, AResultIsNoFileThatIsRead) {
  EXPECT_EQ(refusal_of([&] { require_apart({b, gone, ""}, {a}); }), "");
  EXPECT_EQ(refusal_of([&] {
              require_apart({b, a}, {gone, a});
            }),
            a + ": is read, and would be lost: name another file");
  for (const char* other : {"link", "hard", "./a"}) {
    const std::string name = folder.file(other);
    EXPECT_EQ(refusal_of([&] {
                require_apart({name}, {b, a});
              }),
              name + ": is the same file as " + a + ", which is read: name another file");
    EXPECT_EQ(refusal_of([&] { require_apart({a}, {name}); }),
              a + ": is the same file as " + name + ", which is read: name another file");
  }
}

TEST_F(NamedFiles, WhatIsNotThereOrHoldsNothingIsApart) {
  EXPECT_EQ(refusal_of([&] { require_apart({gone}, {gone}); }), "");
  EXPECT_EQ(refusal_of([&] { require_apart({""}, {""}); }), "");
  EXPECT_EQ(refusal_of([&] { require_apart({}, {a}); }), "");
  EXPECT_EQ(refusal_of([&] { require_apart({a}, {}); }), "");
  // nothing takes the place of a device
  EXPECT_EQ(refusal_of([&] { require_apart({"/dev/null"}, {"/dev/null"}); }), "");
}

TEST_F(NamedFiles, WhatIsReadTwiceIsRefused) {
  EXPECT_EQ(refusal_of([&] { require_distinct({a, b, gone, gone, "", ""}); }), "");
  EXPECT_EQ(refusal_of([&] {
              require_distinct({a, b, a});
            }),
            a + ": is named twice: its readings would count twice");
  for (const char* other : {"link", "hard", "./a"}) {
    const std::string name = folder.file(other);
    EXPECT_EQ(refusal_of([&] {
                require_distinct({a, name});
              }),
              name + ": is the same file as " + a + ": its readings would count twice");
  }
}

TEST_F(NamedFiles, TwoResultsAreTwoFiles) {
  EXPECT_EQ(refusal_of([&] { require_writable({a, b, "", "", "/dev/null", "/dev/null"}); }), "");
  EXPECT_EQ(refusal_of([&] {
              require_writable({gone, folder.file("./gone")});
            }),
            folder.file("./gone") + ": is named as the file of two results");
  EXPECT_FALSE(file_exists(gone));
}

TEST(WriteFile, ThreadsThatWriteOnePathDoNotMeet) {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("shared");
  const auto text_of = [](int thread) {
    return std::string(static_cast<std::size_t>(1000 * (thread + 1)), static_cast<char>('a' + thread));
  };
  std::vector<std::string> refusals(4);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; i < 200; ++i)
        if (const std::string refusal = refusal_of([&] { write_file(path, text_of(t)); }); !refusal.empty())
          refusals[static_cast<std::size_t>(t)] = refusal;
    });
  for (std::thread& thread : threads) thread.join();
  for (const std::string& refusal : refusals) EXPECT_EQ(refusal, "");
  const std::string text = read_file(path);
  ASSERT_FALSE(text.empty());
  EXPECT_EQ(text, text_of(text.front() - 'a'));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}),
            1);  // no temporary is left
}

}  // namespace
}  // namespace rangecal
