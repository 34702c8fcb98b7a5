// What OrtiloControl.cpp needs of PX4, by the same names; the headers that it includes are copies of this one.
#pragma once
#include <cstdint>
#define ORB_ID(name) 0
uint64_t hrt_absolute_time();
struct vehicle_attitude_s {
    uint64_t timestamp;
    float q[4];
};
struct vehicle_angular_velocity_s {
    uint64_t timestamp;
    float xyz[3];
};
struct vehicle_acceleration_s {
    uint64_t timestamp;
    float xyz[3];
};
struct vehicle_thrust_setpoint_s {
    uint64_t timestamp;
    float xyz[3];
};
struct vehicle_torque_setpoint_s {
    uint64_t timestamp;
    float xyz[3];
};
namespace uORB {
struct Subscription {
    explicit Subscription(int) {}
    bool update(void *) { return true; }
};
template <typename T> struct Publication {
    explicit Publication(int) {}
    bool publish(const T &) { return true; }
};
}  // namespace uORB
namespace px4 {
namespace wq_configurations {
inline constexpr int rate_ctrl = 0;
}
struct ScheduledWorkItem {
    ScheduledWorkItem(const char *, int) {}
    virtual ~ScheduledWorkItem() = default;
    void ScheduleOnInterval(uint32_t) {}
    virtual void Run() = 0;
};
}  // namespace px4
