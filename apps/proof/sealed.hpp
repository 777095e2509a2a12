// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "scoring.hpp"

namespace rangecal::proof {

/// SHA-256 of the bytes, 64 hexadecimal digits.
std::string sha256(const std::string& bytes);

/// Makes `count` concealed worlds in `folder`/world-01, ... and their keys in `folder`-keys/world-01.json. A key holds what
/// was planted, its parameters, the world's seed and a nonce from the system's random device; the recording's folder holds
/// nothing of it but `commitment.txt`, the SHA-256 of the key's bytes. Ranges and bearings are written with 7 digits.
void make_concealed(const std::string& folder, int count, std::uint64_t seed);

/// Recordings of a concealed folder: itself if it holds recording.yaml, else its subfolders that do, by name.
std::vector<std::string> concealed_recordings(const std::string& folder);
/// The key that belongs to a recording's folder: ../../NAME-keys/world-01.json for .../NAME/world-01.
std::string key_file(const std::string& recording);

/// The world of a key, drawn again, after the key's bytes were checked against the recording's commitment. Throws InputError naming the file if the
/// key or the commitment is missing, or if they do not match.
Case open_key(const std::string& recording);

/// Diagnoses the recordings without looking at keys.
struct SealedAnswer {
  std::string recording;
  Diagnosis diagnosis;
  double seconds = 0.0;
};
SealedAnswer answer_sealed(const std::string& recording, const Diagnose& diagnose);

/// Opens the key and scores the answer, gain over the oracle included.
Score score_sealed(const SealedAnswer& answer, const Diagnose& diagnose);

}  // namespace rangecal::proof
