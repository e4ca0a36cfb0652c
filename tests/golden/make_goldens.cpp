// What PCL computes on the inputs that make_goldens.py gives it, as lines "name value value ...".
//   make_goldens version
//   make_goldens cloud  PR RADIUS < n, then n rows x y z, then the number of keypoints and their rows
//   make_goldens groups GC_SIZE HOUGH_BIN < n, then n rows x y z x' y' z', source frame (9), target frame (9), distance
#include <pcl/correspondence.h>
#include <pcl/features/fpfh.h>
#include <pcl/features/normal_3d.h>
#include <pcl/features/shot.h>
#include <pcl/keypoints/harris_3d.h>
#include <pcl/keypoints/iss_3d.h>
#include <pcl/pcl_config.h>
#include <pcl/point_types.h>
#include <pcl/recognition/cg/geometric_consistency.h>
#include <pcl/recognition/cg/hough_3d.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

namespace {

using Point = pcl::PointXYZ;
using Cloud = pcl::PointCloud<Point>;
using Normals = pcl::PointCloud<pcl::Normal>;
using Frames = pcl::PointCloud<pcl::ReferenceFrame>;

template <class T>
T read() {
  T value;
  if (!(std::cin >> value)) {
    std::fprintf(stderr, "make_goldens: the input is too short\n");
    std::exit(2);
  }
  return value;
}

Point read_point() {
  const float x = read<float>(), y = read<float>();
  return Point(x, y, read<float>());
}

template <class Values>
void print(const char* name, const Values& values) {
  std::printf("%s", name);
  for (const auto value : values) std::printf(" %.9g", static_cast<double>(value));
  std::printf("\n");
}

// ---- a cloud

Normals::Ptr normals(const Cloud::ConstPtr& cloud) {
  pcl::NormalEstimation<Point, pcl::Normal> estimation;
  estimation.setInputCloud(cloud);
  estimation.setKSearch(20);
  Normals::Ptr found(new Normals);
  estimation.compute(*found);
  std::vector<float> values;
  for (const auto& normal : *found) values.insert(values.end(), normal.normal, normal.normal + 3);
  print("normals", values);
  return found;
}

void harris(const Cloud::ConstPtr& cloud, float pr) {
  pcl::HarrisKeypoint3D<Point, pcl::PointXYZI> detector;
  detector.setInputCloud(cloud);
  detector.setNonMaxSupression(true);
  detector.setRefine(false);
  detector.setThreshold(0.0f);
  detector.setRadius(2.7f * pr);
  pcl::PointCloud<pcl::PointXYZI> found;
  detector.compute(found);
  print("harris", detector.getKeypointsIndices()->indices);
}

void iss(const Cloud::ConstPtr& cloud, double pr) {
  pcl::ISSKeypoint3D<Point, Point> detector;
  detector.setInputCloud(cloud);
  detector.setSalientRadius(2.7 * pr);
  detector.setNonMaxRadius(1.8 * pr);
  detector.setThreshold21(0.975);
  detector.setThreshold32(0.975);
  detector.setMinNeighbors(5);
  Cloud found;
  detector.compute(found);
  print("iss", detector.getKeypointsIndices()->indices);
}

void shot(const Cloud::ConstPtr& cloud, const Normals::ConstPtr& around, const pcl::IndicesPtr& keypoints, double radius) {
  pcl::SHOTEstimation<Point, pcl::Normal, pcl::SHOT352> estimation;
  estimation.setInputCloud(cloud);
  estimation.setIndices(keypoints);
  estimation.setInputNormals(around);
  estimation.setRadiusSearch(radius);
  pcl::PointCloud<pcl::SHOT352> found;
  estimation.compute(found);
  std::vector<float> descriptors, frames;
  for (const auto& one : found) {
    descriptors.insert(descriptors.end(), one.descriptor, one.descriptor + 352);
    frames.insert(frames.end(), one.rf, one.rf + 9);
  }
  print("shot_lrf", frames);
  print("shot352", descriptors);
}

void fpfh(const Cloud::ConstPtr& cloud, const Normals::ConstPtr& around, const pcl::IndicesPtr& keypoints, double radius) {
  pcl::FPFHEstimation<Point, pcl::Normal, pcl::FPFHSignature33> estimation;
  estimation.setInputCloud(cloud);
  estimation.setIndices(keypoints);
  estimation.setInputNormals(around);
  estimation.setRadiusSearch(radius);
  pcl::PointCloud<pcl::FPFHSignature33> found;
  estimation.compute(found);
  std::vector<float> values;
  for (const auto& one : found) values.insert(values.end(), one.histogram, one.histogram + 33);
  print("fpfh", values);
}

void describe_cloud(double pr, double radius) {
  Cloud::Ptr cloud(new Cloud);
  for (int left = read<int>(); left > 0; --left) cloud->push_back(read_point());
  pcl::IndicesPtr keypoints(new pcl::Indices);
  for (int left = read<int>(); left > 0; --left) keypoints->push_back(read<int>());
  const Normals::Ptr around = normals(cloud);
  harris(cloud, static_cast<float>(pr));
  iss(cloud, pr);
  shot(cloud, around, keypoints, radius);
  fpfh(cloud, around, keypoints, radius);
}

// ---- matches

pcl::ReferenceFrame read_frame() {
  pcl::ReferenceFrame frame;
  for (float* axis : {frame.x_axis, frame.y_axis, frame.z_axis})
    for (int i = 0; i < 3; ++i) axis[i] = read<float>();
  return frame;
}

template <class Grouping>
void print_largest(const char* name, Grouping& grouping) {
  std::vector<Eigen::Matrix4f, Eigen::aligned_allocator<Eigen::Matrix4f>> poses;
  std::vector<pcl::Correspondences> groups;
  grouping.recognize(poses, groups);
  const auto largest = std::max_element(groups.begin(), groups.end(),
                                        [](const auto& a, const auto& b) { return a.size() < b.size(); });
  std::vector<int> rows;
  if (largest != groups.end())
    for (const auto& match : *largest) rows.push_back(match.index_query);
  std::sort(rows.begin(), rows.end());
  print(name, rows);
}

void group_matches(double gc_size, double hough_bin) {
  Cloud::Ptr source(new Cloud), target(new Cloud);
  Frames::Ptr source_frames(new Frames), target_frames(new Frames);
  pcl::CorrespondencesPtr matches(new pcl::Correspondences);
  const int n = read<int>();
  for (int i = 0; i < n; ++i) {
    source->push_back(read_point());
    target->push_back(read_point());
    source_frames->push_back(read_frame());
    target_frames->push_back(read_frame());
    matches->emplace_back(i, i, read<float>());
  }
  pcl::GeometricConsistencyGrouping<Point, Point> consistency;
  consistency.setGCSize(gc_size);
  consistency.setGCThreshold(3);
  consistency.setInputCloud(source);
  consistency.setSceneCloud(target);
  consistency.setModelSceneCorrespondences(matches);
  print_largest("gc", consistency);
  pcl::Hough3DGrouping<Point, Point> hough;
  hough.setHoughBinSize(hough_bin);
  hough.setHoughThreshold(-1.0);
  hough.setUseInterpolation(true);
  hough.setUseDistanceWeight(false);
  hough.setInputCloud(source);
  hough.setInputRf(source_frames);
  hough.setSceneCloud(target);
  hough.setSceneRf(target_frames);
  hough.setModelSceneCorrespondences(matches);
  print_largest("hough", hough);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "";
  if (what == "version") std::puts(PCL_VERSION_PRETTY);
  else if (what == "cloud" && argc == 4) describe_cloud(std::atof(argv[2]), std::atof(argv[3]));
  else if (what == "groups" && argc == 4) group_matches(std::atof(argv[2]), std::atof(argv[3]));
  else {
    std::fprintf(stderr, "usage: make_goldens version | cloud PR RADIUS | groups GC_SIZE HOUGH_BIN\n");
    return 2;
  }
  return 0;
}
