"""The ensemble engine: whole flights compiled into one loop, of the very functions that the Drake systems call.

The order of a tick k, as Drake's diagrams have it (diagrams/closed_loop.py: every output is read before any update):

    x_k                 the true state; u_{k-1} and d_{k-1}, held over the tick that ended, are what the imu feels
    messages            imu, uwb and detections of x_k; its link says whether each is sent, and which one lands
    fixes               about the prediction xhat_{k|k-1}, the belief that the filter holds; the tight filter needs none
    y_k, delta_k, V2    the handler's, weighed where the estimator is robust
    u_k                 the servo's, of xhat_{k|k-1}, the reference r_k and the force as it is believed to be
    a row of the log    x_k, u_k, y_k, delta_k, V2, xhat_{k|k-1}, P_k, r_k
    xhat_{k+1|k}        the filter's step with y_k and u_k
    slow errors         of the sensors and of the lasting force, one tick on
    d_k, x_{k+1}        one step of the classical Runge-Kutta method under u_k and d_k (world.plant: sampled), or
                        third-order ones as Drake's integrator takes them; samples of an imu faster than the tick
    links               messages put in flight, the chain of losses steps

The noise is that of the counter-based streams of world/noise.py, so a flight depends on its scenario and seed alone.
"""
