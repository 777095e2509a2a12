// SPDX-License-Identifier: BSD-3-Clause
#include "mpi_program.hpp"

#include <unistd.h>

#include <cstdlib>
#include <filesystem>

#include "logging.hpp"

namespace rangecal::app {

bool started_by_mpirun() {
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"}) {
    const char* size = std::getenv(name);
    if (size && std::atoi(size) > 1) return true;
  }
  return false;
}

void become_mpi_program(std::vector<std::string> words, const std::string& way_out) {
  const std::string program =
      (std::filesystem::read_symlink("/proc/self/exe").parent_path() / "rangecal-mpi").string();
  if (verbose_level > 0) words.insert(words.begin(), "--verbose=" + std::to_string(verbose_level));
  words.insert(words.begin(), program);
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  ::execv(program.c_str(), arguments.data());
  throw InputError("started by mpirun, but built without MPI (" + program +
                   " is missing): build with libopenmpi-dev installed, or " + way_out);
}

}  // namespace rangecal::app
