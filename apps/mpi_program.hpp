// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace rangecal::app {

/// Whether this process is one of several ranks (set by OpenMPI, MPICH and Slurm in each that they start).
bool started_by_mpirun();

/// Becomes the program that carries MPI, which stands beside this one so that no other command needs MPI to start. Throws
/// InputError with the way out where it is not there.
[[noreturn]] void become_mpi_program(std::vector<std::string> words, const std::string& way_out);

}  // namespace rangecal::app
