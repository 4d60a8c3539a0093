// SPDX-License-Identifier: Apache-2.0
#include "tests/support/fake_genicam.h"

#include <arpa/inet.h>
#include <arv.h>
#include <net/if.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace refield::test {

bool enter_private_network() {
  if (unshare(CLONE_NEWNET) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) return false;
  const int socket_number = socket(AF_INET, SOCK_DGRAM, 0);
  ifreq loopback{};
  std::strcpy(loopback.ifr_name, "lo");
  loopback.ifr_flags = IFF_UP | IFF_RUNNING;
  bool good = ioctl(socket_number, SIOCSIFFLAGS, &loopback) == 0;
  ifreq second{};
  std::strcpy(second.ifr_name, "lo:1");
  auto* address = reinterpret_cast<sockaddr_in*>(&second.ifr_addr);
  address->sin_family = AF_INET;
  inet_pton(AF_INET, "127.0.0.2", &address->sin_addr);
  good = ioctl(socket_number, SIOCSIFADDR, &second) == 0 && good;
  close(socket_number);
  return good;
}

struct FakeGenicam::State {
  FakeDraw draw;
  ArvGvFakeCamera* camera = nullptr;
};

namespace {

void fill(ArvBuffer* buffer, void* draw, guint32 exposure_us, guint32 gain, ArvPixelFormat format) {
  static const std::pair<ArvPixelFormat, const char*> names[] = {{ARV_PIXEL_FORMAT_MONO_8, "Mono8"},
                                                                 {ARV_PIXEL_FORMAT_MONO_12, "Mono12"},
                                                                 {ARV_PIXEL_FORMAT_MONO_16, "Mono16"},
                                                                 {0x010A0046, "Mono10p"},
                                                                 {0x010C0006, "Mono12Packed"},
                                                                 {ARV_PIXEL_FORMAT_RGB_8_PACKED, "RGB8"},
                                                                 {ARV_PIXEL_FORMAT_BAYER_RG_8, "BayerRG8"},
                                                                 {ARV_PIXEL_FORMAT_BAYER_RG_12, "BayerRG12"},
                                                                 {ARV_PIXEL_FORMAT_BAYER_GR_8, "BayerGR8"},
                                                                 {ARV_PIXEL_FORMAT_BAYER_GB_8, "BayerGB8"},
                                                                 {ARV_PIXEL_FORMAT_BAYER_BG_8, "BayerBG8"}};
  FakeExposure exposure;
  for (const auto& [code, name] : names)
    if (code == format) exposure.format = name;
  exposure.width = arv_buffer_get_image_width(buffer);
  exposure.height = arv_buffer_get_image_height(buffer);
  auto* data = static_cast<std::uint8_t*>(const_cast<void*>(arv_buffer_get_data(buffer, nullptr)));
  exposure.bytes = {
      data, std::size_t{1} * exposure.width * exposure.height * ARV_PIXEL_FORMAT_BIT_PER_PIXEL(format) / 8};
  exposure.microseconds = exposure_us;
  exposure.gain_db = gain / 10.0;
  (*static_cast<FakeDraw*>(draw))(exposure);
}

std::string camera_description(bool stubborn) {
  ArvFakeCamera* plain = arv_fake_camera_new("plain");
  std::size_t size = 0;
  const char* text = arv_fake_camera_get_genicam_xml(plain, &size);
  std::string xml(text, size);
  g_object_unref(plain);
  const auto insert_before = [&](const std::string& place, const std::string& addition) {
    const auto at = xml.rfind(place);
    if (at == std::string::npos)
      throw std::runtime_error("Aravis' description of its fake camera has changed");
    xml.insert(at, addition);
  };
  const auto register_of = [](const std::string& name, const std::string& address) {
    return "<IntReg Name=\"" + name + "\"><Address>" + address +
           "</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign>"
           "<Endianess>BigEndian</Endianess></IntReg>";
  };
  std::string formats;
  for (const auto& [name, code] : {std::pair{"Mono12", 0x01100005},
                                   {"Mono10p", 0x010A0046},
                                   {"Mono12Packed", 0x010C0006},
                                   {"BayerRG12", 0x01100011},
                                   {"YUV422_8", 0x02100032}})
    formats += std::string("<EnumEntry Name=\"") + name + "\"><Value>" + std::to_string(code) +
               "</Value></EnumEntry>";
  insert_before("<pValue>PixelFormatRegister</pValue>", formats);
  insert_before(
      "</RegisterDescription>",
      "<Float Name=\"Gain\"><pValue>GainInDecibels</pValue><Min>0</Min><Max>24</Max><Unit>dB</Unit></Float>"
      "<Converter Name=\"GainInDecibels\"><FormulaTo>FROM*10</FormulaTo><FormulaFrom>TO/10</FormulaFrom>"
      "<pValue>GainRawRegister</pValue></Converter>"
      "<Integer Name=\"BlackLevel\"><pValue>BlackLevelRegister</pValue><Min>0</Min><Max>255</Max></Integer>" +
          register_of("BlackLevelRegister", "0x8000") +
          "<Float Name=\"Gamma\"><pValue>GammaInHundredths</pValue><Min>0</Min><Max>4</Max></Float>"
          "<Converter Name=\"GammaInHundredths\"><FormulaTo>FROM*100</FormulaTo>"
          "<FormulaFrom>TO/100</FormulaFrom><pValue>GammaRegister</pValue></Converter>" +
          register_of("GammaRegister", "0x8004"));
  if (stubborn)
    insert_before(
        "</RegisterDescription>",
        "<Enumeration Name=\"ExposureAuto\"><EnumEntry Name=\"Continuous\"><Value>0</Value></EnumEntry>"
        "<EnumEntry Name=\"Off\"><Value>1</Value></EnumEntry><pValue>ExposureAutoRegister</pValue>"
        "</Enumeration><IntSwissKnife Name=\"ExposureAutoRegister\"><Formula>0</Formula></IntSwissKnife>");
  return xml;
}

}  // namespace

FakeGenicam::FakeGenicam(const std::string& address, const std::string& serial, FakeDraw draw, bool stubborn)
    : state_(std::make_unique<State>(State{std::move(draw)})) {
  const auto file =
      std::filesystem::temp_directory_path() / ("refield-camera-" + std::to_string(getpid()) + ".xml");
  std::ofstream(file) << camera_description(stubborn);
  state_->camera = arv_gv_fake_camera_new_full(address.c_str(), serial.c_str(), file.c_str());
  std::filesystem::remove(file);
  if (!arv_gv_fake_camera_is_running(state_->camera))
    throw std::runtime_error("no fake camera can be made at " + address);
  ArvFakeCamera* camera = arv_gv_fake_camera_get_fake_camera(state_->camera);
  arv_fake_camera_write_register(camera, 0x8004, 45);    // a gamma of 0.45, as cameras come
  arv_fake_camera_set_trigger_frequency(camera, 200.0);  // how often it looks for a software trigger, Hz
  arv_fake_camera_set_fill_pattern(camera, fill, &state_->draw);
}

FakeGenicam::~FakeGenicam() {
  g_object_unref(state_->camera);
}

void FakeGenicam::lose(double share) {
  g_object_set(state_->camera, "gvsp-lost-ratio", share, nullptr);
}

}  // namespace refield::test
