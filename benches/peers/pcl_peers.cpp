// PCL's grouping methods on one case: `pcl_peers gc|gc10|hough|ransac CASE.bin` prints one record in JSON, and
// `pcl_peers version` PCL's version. Rules of repetition and memory: measure.py. Layout of a case: cases.py.
// Lengths are in pr, which is 1 there.
#include <pcl/correspondence.h>
#include <pcl/pcl_config.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/recognition/cg/geometric_consistency.h>
#include <pcl/recognition/cg/hough_3d.h>
#include <pcl/registration/correspondence_rejection_sample_consensus.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <numeric>
#include <string>
#include <vector>
#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace {

using Point = pcl::PointXYZ;
using Cloud = pcl::PointCloud<Point>;
using Frames = pcl::PointCloud<pcl::ReferenceFrame>;
using Poses = std::vector<Eigen::Matrix4f, Eigen::aligned_allocator<Eigen::Matrix4f>>;

constexpr double kGcTolerance = 3.0;
constexpr double kInlierResidual = 5.0;
constexpr double kHoughBin = 5.0;
constexpr int kIterations = 10000;

[[noreturn]] void fail(const std::string& message) {
  std::fprintf(stderr, "pcl_peers: %s\n", message.c_str());
  std::exit(2);
}

// ---- the case

struct Case {
  std::uint32_t n = 0;
  std::vector<float> src, tgt, lrf_src, lrf_tgt, sim;
};

template <class T>
std::vector<T> read(std::ifstream& file, std::size_t count) {
  std::vector<T> values(count);
  file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(count * sizeof(T)));
  if (!file) fail("the case is too short");
  return values;
}

Case load(const char* path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) fail(std::string("cannot read ") + path);
  const auto magic = read<char>(file, 4);
  if (std::memcmp(magic.data(), "CGC2", 4) != 0) fail(std::string(path) + " is not a case");
  Case c;
  c.n = read<std::uint32_t>(file, 1)[0];
  c.src = read<float>(file, 3u * c.n);
  c.tgt = read<float>(file, 3u * c.n);
  c.lrf_src = read<float>(file, 9u * c.n);
  c.lrf_tgt = read<float>(file, 9u * c.n);
  c.sim = read<float>(file, c.n);
  return c;
}

Cloud::Ptr to_cloud(const std::vector<float>& values) {
  Cloud::Ptr cloud(new Cloud);
  for (std::size_t i = 0; i < values.size(); i += 3)
    cloud->push_back(Point(values[i], values[i + 1], values[i + 2]));
  return cloud;
}

Frames::Ptr to_frames(const std::vector<float>& values) {
  Frames::Ptr frames(new Frames);
  for (std::size_t i = 0; i < values.size(); i += 9) {
    pcl::ReferenceFrame frame;
    std::copy_n(&values[i], 3, frame.x_axis);
    std::copy_n(&values[i + 3], 3, frame.y_axis);
    std::copy_n(&values[i + 6], 3, frame.z_axis);
    frames->push_back(frame);
  }
  return frames;
}

// ---- time and memory

std::vector<double> measure(const std::function<void()>& call) {
  using Clock = std::chrono::steady_clock;
  constexpr std::size_t kMost = 9, kLeast = 3;
  constexpr double kBudget = 1.0, kLong = 15.0;
  std::vector<double> times;
  for (;;) {
    const auto start = Clock::now();
    call();
    times.push_back(std::chrono::duration<double>(Clock::now() - start).count());
    const double spent = std::accumulate(times.begin(), times.end(), 0.0);
    if (times.size() == kMost || times.back() > kLong || (times.size() >= kLeast && spent > kBudget)) return times;
  }
}

void reset_peak() {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
  std::ofstream("/proc/self/clear_refs") << "5";
}

double peak_mib() {
  std::ifstream file("/proc/self/status");
  for (std::string line; std::getline(file, line);)
    if (line.rfind("VmHWM:", 0) == 0) return std::atof(line.c_str() + 6) / 1024;
  return 0;
}

// ---- the methods

void keep_largest(const std::vector<pcl::Correspondences>& groups, pcl::Correspondences& kept) {
  const auto largest = std::max_element(groups.begin(), groups.end(),
                                        [](const auto& a, const auto& b) { return a.size() < b.size(); });
  kept = largest == groups.end() ? pcl::Correspondences() : *largest;
}

std::function<void()> prepared(const std::string& method, const Case& c, pcl::Correspondences& kept) {
  const Cloud::Ptr source = to_cloud(c.src), target = to_cloud(c.tgt);
  pcl::CorrespondencesPtr matches(new pcl::Correspondences);
  for (std::uint32_t i = 0; i < c.n; ++i) matches->emplace_back(int(i), int(i), 1.0f - c.sim[i]);

  if (method == "gc" || method == "gc10") {
    const int threshold = method == "gc" ? 3 : 10;
    return [=, &kept] {
      pcl::GeometricConsistencyGrouping<Point, Point> grouping;
      grouping.setGCSize(kGcTolerance);
      grouping.setGCThreshold(threshold);
      grouping.setInputCloud(source);
      grouping.setSceneCloud(target);
      grouping.setModelSceneCorrespondences(matches);
      Poses poses;
      std::vector<pcl::Correspondences> groups;
      grouping.recognize(poses, groups);
      keep_largest(groups, kept);
    };
  }
  if (method == "hough") {
    const Frames::Ptr source_frames = to_frames(c.lrf_src), target_frames = to_frames(c.lrf_tgt);
    return [=, &kept] {
      pcl::Hough3DGrouping<Point, Point> grouping;
      grouping.setHoughBinSize(kHoughBin);
      grouping.setHoughThreshold(-1.0);  // the highest bins only
      grouping.setUseInterpolation(true);
      grouping.setUseDistanceWeight(false);
      grouping.setInputCloud(source);
      grouping.setInputRf(source_frames);
      grouping.setSceneCloud(target);
      grouping.setSceneRf(target_frames);
      grouping.setModelSceneCorrespondences(matches);
      Poses poses;
      std::vector<pcl::Correspondences> groups;
      grouping.recognize(poses, groups);
      keep_largest(groups, kept);
    };
  }
  if (method == "ransac") {
    return [=, &kept] {
      pcl::registration::CorrespondenceRejectorSampleConsensus<Point> rejector;
      rejector.setInputSource(source);
      rejector.setInputTarget(target);
      rejector.setInlierThreshold(kInlierResidual);
      rejector.setMaximumIterations(kIterations);
      kept.clear();
      rejector.getRemainingCorrespondences(*matches, kept);
    };
  }
  fail("no method " + method);
}

// The mask in hexadecimal digits, the first match in the highest bit: answers.py reads it.
std::string packed(const pcl::Correspondences& kept, std::uint32_t n) {
  std::vector<unsigned> bytes((n + 7) / 8);
  for (const auto& match : kept) bytes[match.index_query / 8] |= 128u >> (match.index_query % 8);
  std::string digits;
  char two[3];
  for (const unsigned byte : bytes) {
    std::snprintf(two, sizeof two, "%02x", byte);
    digits += two;
  }
  return digits;
}

void print(const std::vector<double>& times, double base, double peak, const std::string& mask) {
  std::printf("@@{\"times_s\": [");
  for (std::size_t i = 0; i < times.size(); ++i) std::printf("%s%.7f", i ? ", " : "", times[i]);
  std::printf("], \"base_mib\": %.2f, \"peak_mib\": %.2f, \"mask\": \"%s\"}\n", base, peak, mask.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && !std::strcmp(argv[1], "version")) {
    std::puts(PCL_VERSION_PRETTY);
    return 0;
  }
  if (argc != 3) fail("usage: pcl_peers gc|gc10|hough|ransac CASE.bin");
  const Case c = load(argv[2]);
  pcl::Correspondences kept;
  const auto call = prepared(argv[1], c, kept);
  reset_peak();
  const double base = peak_mib();
  const auto times = measure(call);
  const double peak = peak_mib();
  print(times, base, peak, packed(kept, c.n));
  return 0;
}
