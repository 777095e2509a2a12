// SPDX-License-Identifier: BSD-3-Clause
// Every reader is fed with mutants of its seeds (make_seeds.py) and of tests/data/hostile: bytes flipped, numbers replaced by
// hostile ones, pieces cut out, doubled, swapped with another seed's. It takes them or says no in one line. Where `make fuzz` with
// sanitizers looks for long, this looks for some 20 s in all, at every commit. RANGECAL_MUTANTS (`make test` sets it to the commit)
// draws others. The mutant that is being read lies in BUILD/fuzz/mutants/READER: what crashes the program is there.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "fuzz/readers.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::fuzz {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> seeds_of(const std::string& reader) {
  std::vector<fs::path> paths;
  for (const fs::path& folder : {fs::path(RANGECAL_BINARY_DIR) / "fuzz/seeds" / reader,
                                 fs::path(RANGECAL_SOURCE_DIR) / "tests/data/hostile" / reader})
    if (fs::is_directory(folder))
      for (const auto& entry : fs::directory_iterator(folder)) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  std::vector<std::string> seeds;
  for (const fs::path& path : paths) seeds.push_back(read_file(path.string()));
  return seeds;
}

std::size_t place_in(const std::string& text, Random& r) { return r.index(text.size() + 1); }

/// Where a number or word begins and ends around a place.
std::pair<std::size_t, std::size_t> word_at(const std::string& text, std::size_t at) {
  constexpr std::string_view ends = " \t\r\n,;:[]{}\"";
  const auto ends_it = [&](std::size_t i) { return ends.find(text[i]) != std::string_view::npos; };
  std::size_t begin = at, end = at;
  while (begin > 0 && !ends_it(begin - 1)) --begin;
  while (end < text.size() && !ends_it(end)) ++end;
  return {begin, end};
}

void mutate(std::string& text, const std::vector<std::string>& seeds, Random& r) {
  static const std::vector<std::string> words{"",
                                              "0",
                                              "-1",
                                              "1e308",
                                              "-1e308",
                                              "1e-320",
                                              "nan",
                                              "inf",
                                              "2147483648",
                                              "-2147483649",
                                              "18446744073709551616",
                                              "0x1p9",
                                              "null",
                                              "true",
                                              "[]",
                                              "{}",
                                              "\"",
                                              "\n",
                                              "\r\n",
                                              ",,,",
                                              "\xff\xfe",
                                              "\xc3",
                                              "~",
                                              "&a",
                                              "*a",
                                              "!!int",
                                              "1,5",
                                              "1e",
                                              "- -",
                                              "1 2",
                                              "\t"};
  const std::size_t at = place_in(text, r);
  const std::size_t length = std::min<std::size_t>(text.size() - at, 1 + r.index(64));
  switch (r.index(7)) {
    case 0:
      if (at < text.size()) text[at] = static_cast<char>(text[at] ^ (1 << r.index(8)));
      break;
    case 1:
      text.erase(at, length);
      break;
    case 2:
      text.insert(at, std::string(text, at, length));
      break;
    case 3: {
      const auto [begin, end] = word_at(text, at);
      text.replace(begin, end - begin, words[r.index(words.size())]);
      break;
    }
    case 4:
      text.insert(at, words[r.index(words.size())]);
      break;
    case 5: {
      const std::string& other = seeds[r.index(seeds.size())];
      text.replace(at, length, other, place_in(other, r), 1 + r.index(256));
      break;
    }
    default:
      text.resize(at);
  }
}

class Mutants : public ::testing::TestWithParam<std::size_t> {};  // a place among readers()

TEST_P(Mutants, AreTakenOrRefusedInOneLine) {
  constexpr std::size_t longest = 16384;
  const Reader& reader = readers()[GetParam()];
  const std::string name = reader.name;
  const std::vector<std::string> seeds = seeds_of(name);
  if (seeds.empty()) GTEST_SKIP() << "no seeds: make_seeds.py has not run";
  const bool slow = name == "track" || name == "lego" || name == "mcap" || name == "sqlite";
  const int count = name == "bag" ? 150 : slow ? 1500 : 4000;  // each bag is read by a process of its own
  const char* drawn = std::getenv("RANGECAL_MUTANTS");
  Random r(seed_from("Mutants " + name + " " + (drawn ? drawn : "")));
  const fs::path kept = fs::path(RANGECAL_BINARY_DIR) / "fuzz/mutants";
  fs::create_directories(kept);
  for (int i = 0; i < count; ++i) {
    std::string text = seeds[r.index(seeds.size())];
    if (text.size() > longest) text.resize(longest);
    for (std::uint64_t step = 0, steps = 1 + r.index(4); step < steps; ++step) mutate(text, seeds, r);
    std::ofstream(kept / name, std::ios::binary)
        .write(text.data(), static_cast<std::streamsize>(text.size()));
    ASSERT_NO_THROW(feed(reader, text)) << "mutant " << i << ", kept as " << kept / name;
  }
}

INSTANTIATE_TEST_SUITE_P(Readers, Mutants, ::testing::Range<std::size_t>(0, readers().size()),
                         [](const auto& one) { return std::string(readers()[one.param].name); });

}  // namespace
}  // namespace rangecal::fuzz
