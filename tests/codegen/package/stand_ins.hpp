// What the pieces of the guide use of ROS 2 and of the library of solvers: names and types, and nothing behind them.
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <tendon_vishard4.hpp>
#include <vector>

namespace rclcpp {
struct Time {};
struct Duration {
  double seconds() const { return 0.001; }
};
}  // namespace rclcpp

namespace controller_interface {
enum class return_type { OK, ERROR };
struct Interface {
  double value = 0.0;
  double get_value() const { return value; }
  void set_value(double to) { value = to; }
};
}  // namespace controller_interface

struct Desired {
  std::array<double, 4> q{}, qd{}, qdd{};
};

struct Compensation {
  controller_interface::return_type update(const rclcpp::Time &, const rclcpp::Duration &period);
  std::vector<controller_interface::Interface> state_interfaces_{8}, command_interfaces_{4};
  tendon::vishard4::FeedForward forward_;
  Desired desired_;
  std::array<double, 4> tau_{}, kp_{}, kd_{};
};

struct Solver {
  Eigen::MatrixXd getInertiaMatrix(const Eigen::VectorXd &q) const;
  Eigen::VectorXd getFrictionVector(const Eigen::VectorXd &qd) const;
  tendon::vishard4::FeedForward forward_;
};
