// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/descriptor.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>

#include <type_traits>
#include <utility>

#include "support/open_files.hpp"

namespace rangecal {
namespace {

Descriptor opened() { return Descriptor(::open("/dev/null", O_RDONLY | O_CLOEXEC)); }

TEST(Descriptor, IsClosedOnce) {
  static_assert(!std::is_copy_constructible_v<Descriptor> && !std::is_copy_assignable_v<Descriptor>);
  const long before = test::open_files();
  {
    Descriptor first = opened();
    ASSERT_TRUE(first);
    const int number = first.number();
    Descriptor second = std::move(first);
    EXPECT_EQ(second.number(), number);
    EXPECT_FALSE(first);
    EXPECT_EQ(test::open_files(), before + 1);
    second = opened();
    EXPECT_EQ(test::open_files(), before + 1);  // the one that it held is closed
    second = Descriptor();
    EXPECT_FALSE(second);
    EXPECT_EQ(test::open_files(), before);
  }
  EXPECT_EQ(test::open_files(), before);
  EXPECT_FALSE(Descriptor(::open("/nowhere/at/all", O_RDONLY)));
}

struct Refuses {
  Descriptor file = opened();
  Refuses() { throw 1; }
};

TEST(Descriptor, IsClosedWhereAConstructorThrows) {
  const long before = test::open_files();
  EXPECT_THROW(Refuses(), int);
  EXPECT_EQ(test::open_files(), before);
}

}  // namespace
}  // namespace rangecal
