// SPDX-License-Identifier: BSD-3-Clause
#include "sealed.hpp"

#include <fmt/core.h>
#include <openssl/evp.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>

#include "fresh.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/json_numbers.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rows.hpp"

namespace rangecal::proof {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

std::string nonce() {
  std::random_device device;
  std::string out;
  for (int i = 0; i < 8; ++i) out += fmt::format("{:08x}", device());
  return out;
}

/// 7 significant digits: short files, and no grid that noise does not drown.
double rounded(double value) { return std::strtod(fmt::format("{:.7g}", value).c_str(), nullptr); }

void round_readings(Recording& recording) {
  Readings& r = recording.readings;
  for (double& value : r.range_m) value = rounded(value);
  for (double& value : r.bearing_rad) value = rounded(value);
  for (double& value : r.time_s) value = rounded(value);
  for (auto& [name, values] : r.covariates)
    for (double& value : values) value = rounded(value);
}

/// What the concealed worlds are made of; drawn in a shuffled order so that a number tells nothing.
std::vector<std::string> shuffled_rows(int count, Random& random) {
  const std::vector<std::string> menu{"clean",      "lambda-100", "lambda-100", "lambda-50",
                                      "lambda-400", "noise-50",   "noise-50",   "pair",
                                      "twins",      "outside",    "absorbed",   "clean"};
  std::vector<std::string> rows;
  for (int i = 0; i < count; ++i) rows.push_back(menu[static_cast<std::size_t>(i) % menu.size()]);
  for (std::size_t i = rows.size(); i > 1; --i) std::swap(rows[i - 1], rows[random.index(i)]);
  return rows;
}

}  // namespace

std::string sha256(const std::string& bytes) {
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), digest, &size, EVP_sha256(), nullptr) != 1)
    throw std::runtime_error("SHA-256 is not available");
  std::string out;
  for (unsigned int i = 0; i < size; ++i) out += fmt::format("{:02x}", digest[i]);
  return out;
}

void make_concealed(const std::string& folder, int count, std::uint64_t seed) {
  const fs::path root = fs::path(folder).lexically_normal();
  const std::string plain = root.has_filename() ? root.string() : root.parent_path().string();
  if (fs::exists(plain) && !fs::is_empty(plain)) throw InputError(plain + ": is there already and not empty");
  Random random(seed_from("prove.concealed", {seed}));
  const std::vector<std::string> rows = shuffled_rows(count, random);
  make_folder(plain + "-keys");
  for (int i = 0; i < count; ++i) {
    const std::string name = fmt::format("world-{:02}", i + 1),
                      design = random.uniform() < 0.5 ? "line" : "turning";
    const std::uint64_t drawn_from = random.bits();
    const Case c = draw_case(rows[static_cast<std::size_t>(i)], drawn_from, i, design);
    Recording recording = record(c, c.planted);
    recording.truth = {};  // where the stops and landmarks were would tell
    round_readings(recording);
    ordered_json key;
    key["format"] = "rangecal-key/1";
    key["nonce"] = nonce();
    key["row"] = c.row, key["design"] = c.design, key["seed"] = drawn_from, key["index"] = i;
    key["planted"] = c.truth, key["sizes"] = c.sizes;
    key[c.in_nats ? "oracle_nats" : "noncentrality"] = c.value;
    key["truth"] = c.planted.truth;
    const std::string bytes = key.dump(2) + "\n";
    save_recording(recording, plain + "/" + name);
    write_file(plain + "/" + name + "/commitment.txt", sha256(bytes) + "\n");
    write_file(plain + "-keys/" + name + ".json", bytes);
  }
}

std::vector<std::string> concealed_recordings(const std::string& folder) {
  if (file_exists(folder + "/recording.yaml")) return {folder};
  if (!fs::is_directory(folder)) throw InputError(folder + ": no such folder");
  std::vector<std::string> out;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder))
    if (file_exists(entry.path().string() + "/recording.yaml")) out.push_back(entry.path().string());
  std::sort(out.begin(), out.end());
  if (out.empty()) throw InputError(folder + ": holds no recordings");
  return out;
}

std::string key_file(const std::string& recording) {
  fs::path path = fs::absolute(recording).lexically_normal();
  if (!path.has_filename()) path = path.parent_path();
  return path.parent_path().string() + "-keys/" + path.filename().string() + ".json";
}

Case open_key(const std::string& recording) {
  const std::string commitment_file = recording + "/commitment.txt", file = key_file(recording);
  std::string commitment = read_file(commitment_file);
  while (!commitment.empty() && std::isspace(static_cast<unsigned char>(commitment.back())))
    commitment.pop_back();
  const std::string bytes = read_file(file);
  if (sha256(bytes) != commitment)
    throw InputError(file + ": does not match the commitment in " + commitment_file);
  try {
    const nlohmann::json key = nlohmann::json::parse(bytes);
    Case c = draw_case(key.at("row"), key.at("seed").get<std::uint64_t>(), key.at("index"), key.at("design"));
    if (c.truth != key.at("planted").get<std::vector<std::string>>())
      throw InputError(file + ": was made by another version; its world cannot be drawn again");
    c.planted.truth = key.at("truth").get<std::map<std::string, double>>();
    return c;
  } catch (const nlohmann::json::exception& error) {
    throw InputError(file + ": " + json_complaint(error));
  }
}

SealedAnswer answer_sealed(const std::string& recording, const Diagnose& diagnose) {
  const Recording loaded = load_recording(recording);
  SealedAnswer out;
  out.recording = recording;
  const auto begin = std::chrono::steady_clock::now();
  out.diagnosis = diagnose(std::span<const Recording>(&loaded, 1), DiagnoseOptions{});
  out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return out;
}

Score score_sealed(const SealedAnswer& answer, const Diagnose& diagnose) {
  const Case c = open_key(answer.recording);
  Score out = score(c, answer.diagnosis);
  out.seconds = answer.seconds;
  if (!c.truth.empty() && answer.diagnosis.verdict == Verdict::explained)
    add_gain(out, c, load_recording(answer.recording), answer.diagnosis, diagnose);
  return out;
}

}  // namespace rangecal::proof
