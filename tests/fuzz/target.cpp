// SPDX-License-Identifier: BSD-3-Clause
// The entry of libFuzzer: one program, called by as many names as there are readers (fuzz-recording,
// fuzz-csv, ...). An exception that is no InputError ends the run as a finding.
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>

#include "fuzz/readers.hpp"

namespace {

const rangecal::fuzz::Reader* chosen = nullptr;

}  // namespace

extern "C" int LLVMFuzzerInitialize(int*, char*** arguments) {
  const std::string_view program((*arguments)[0]);
  for (const auto& reader : rangecal::fuzz::readers())
    if (program.ends_with(std::string("fuzz-") + reader.name)) chosen = &reader;
  if (chosen) return 0;
  std::fprintf(stderr, "call this program by a link named fuzz-READER\n");
  std::exit(2);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  rangecal::fuzz::feed(*chosen, {reinterpret_cast<const char*>(data), size});
  return 0;
}
