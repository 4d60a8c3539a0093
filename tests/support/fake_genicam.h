// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

namespace refield::test {

/// Moves this process into a network of its own, where 127.0.0.1 and 127.0.0.2 are the only addresses, before
/// it has made any thread that uses the network. False where that is not permitted; the process then stays
/// where it is.
bool enter_private_network();

/// A frame that a fake camera is to fill: it is called when the exposure begins, and may take its time.
struct FakeExposure {
  std::span<std::uint8_t> bytes;
  std::string format;  ///< "Mono16"
  int width = 0;
  int height = 0;
  double microseconds = 0.0;
  double gain_db = 0.0;
};
using FakeDraw = std::function<void(const FakeExposure&)>;

/// Aravis' fake camera: it speaks the real GigE Vision protocol. To the features of Aravis it adds Gain (0 to
/// 24 dB), BlackLevel, Gamma and the formats Mono12, Mono10p, Mono12Packed and BayerRG12. With `stubborn` it
/// has an ExposureAuto that cannot be switched off.
class FakeGenicam {
 public:
  /// Throws std::runtime_error when the address is taken.
  FakeGenicam(const std::string& address, const std::string& serial, FakeDraw draw, bool stubborn = false);
  ~FakeGenicam();
  FakeGenicam(const FakeGenicam&) = delete;
  FakeGenicam& operator=(const FakeGenicam&) = delete;

  /// Share of the packets that it does not send.
  void lose(double share);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace refield::test
