/* An exported onboard half as a PX4 work item: ranges, attitude, rates and acceleration in, thrust and torque out.
 *
 *     ortilo export nominal_imu_uwb --target cortex-m7 --out half
 *
 * Put the folder beside this file in src/modules/ortilo_control; its CMakeLists.txt calls px4_add_module with
 * SRCS OrtiloControl.cpp half/ortilo.c and links half/ortilo_elements.o. Start it in place of mc_rate_control. It is a
 * skeleton: export your own vehicle's scenario first. Nobody has flown it.
 *
 * PX4's W is north, east, down and its B forward, right, down; ortilo's are east, north, up and forward, left, up.
 */
#include <cmath>

#include <px4_platform_common/px4_work_queue/ScheduledWorkItem.hpp>
#include <uORB/Publication.hpp>
#include <uORB/Subscription.hpp>
#include <uORB/topics/vehicle_acceleration.h>
#include <uORB/topics/vehicle_angular_velocity.h>
#include <uORB/topics/vehicle_attitude.h>
#include <uORB/topics/vehicle_thrust_setpoint.h>
#include <uORB/topics/vehicle_torque_setpoint.h>

#include "ortilo.h"

/* The newest ranges of your driver: fill in distances [m], in the order of the room, and return how many there are. */
extern "C" int ortilo_ranges(double *ranges, double *there);

class OrtiloControl : public px4::ScheduledWorkItem {
public:
    static constexpr unsigned PERIOD_US = 33333;  // of a tick, of the scenario
    static constexpr float MOST_THRUST = 25.0f;   // of your vehicle [N]
    static constexpr float MOST_TORQUE = 1.0f;    // [N m]

    OrtiloControl() : ScheduledWorkItem("ortilo_control", px4::wq_configurations::rate_ctrl) {
        ortilo_init(&_half, nullptr);
        ScheduleOnInterval(PERIOD_US);
    }

private:
    void Run() override {
        vehicle_attitude_s attitude{};
        vehicle_angular_velocity_s rates{};
        vehicle_acceleration_s acceleration{};
        const double now = static_cast<double>(_half.state.tick) * PERIOD_US * 1e-6;
        _inputs = {};
        if (_attitude.update(&attitude) && _rates.update(&rates) && _acceleration.update(&acceleration)) {
            _inputs.imu.arrived = 1.0;
            _inputs.imu.stamp = now;
            const double w = attitude.q[0], x = attitude.q[1], y = attitude.q[2], z = attitude.q[3];
            _inputs.imu.angles[0] = std::atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y));
            _inputs.imu.angles[1] = -std::asin(2.0 * (w * y - z * x));
            _inputs.imu.angles[2] = std::remainder(
                0.5 * M_PI - std::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)), 2.0 * M_PI);
            for (int i = 0; i < 3; i++) {
                const double sign = i == 0 ? 1.0 : -1.0;
                _inputs.imu.rates[i] = sign * static_cast<double>(rates.xyz[i]);
                _inputs.imu.force[i] = sign * static_cast<double>(acceleration.xyz[i]);
            }
        }
        _inputs.uwb.arrived = ortilo_ranges(_inputs.uwb.ranges, _inputs.uwb.there) > 0 ? 1.0 : 0.0;
        _inputs.uwb.stamp = now;
        if (ortilo_tick(&_half, &_inputs, &_outputs) != 0) return;  // functions had to stop: your failsafe's time

        vehicle_thrust_setpoint_s thrust{};
        thrust.xyz[2] = -static_cast<float>(_outputs.control[0]) / MOST_THRUST;
        vehicle_torque_setpoint_s torque{};
        torque.xyz[0] = static_cast<float>(_outputs.control[1]) / MOST_TORQUE;
        torque.xyz[1] = -static_cast<float>(_outputs.control[2]) / MOST_TORQUE;
        torque.xyz[2] = -static_cast<float>(_outputs.control[3]) / MOST_TORQUE;
        thrust.timestamp = torque.timestamp = hrt_absolute_time();
        _thrust.publish(thrust);
        _torque.publish(torque);
    }

    ortilo _half{};
    ortilo_inputs _inputs{};
    ortilo_outputs _outputs{};
    uORB::Subscription _attitude{ORB_ID(vehicle_attitude)};
    uORB::Subscription _rates{ORB_ID(vehicle_angular_velocity)};
    uORB::Subscription _acceleration{ORB_ID(vehicle_acceleration)};
    uORB::Publication<vehicle_thrust_setpoint_s> _thrust{ORB_ID(vehicle_thrust_setpoint)};
    uORB::Publication<vehicle_torque_setpoint_s> _torque{ORB_ID(vehicle_torque_setpoint)};
};
