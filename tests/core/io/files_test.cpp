// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/files.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <functional>

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

}  // namespace
}  // namespace rangecal
