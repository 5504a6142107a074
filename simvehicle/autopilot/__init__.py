"""The simulated autopilots: what a companion computer or a ground station meets on a link.

`core` flies the vehicle and keeps time; `inbox` and `commands` answer messages; `missions`, `parameters` and
`streams` are MAVLink's services; `maneuvers` and `mission_run` say where to fly, `control` and `estimator` how.
The flavours stand in `ardupilot*` and `px4*`. The reference for the first is a recorded flight.
"""
