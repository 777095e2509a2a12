// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/descriptor.hpp"

#include <unistd.h>

namespace rangecal {

Descriptor::~Descriptor() {
  if (number_ >= 0) ::close(number_);
}

}  // namespace rangecal
