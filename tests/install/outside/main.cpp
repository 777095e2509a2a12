// SPDX-License-Identifier: BSD-3-Clause
// Prints the version of the installed library.
#include <iostream>
#include <rangecal/core/version.hpp>

int main() { std::cout << "rangecal " << rangecal::version() << '\n'; }
