"""AMCL's particle filter, particle by particle."""

from __future__ import annotations

import itertools
import math

import numpy as np

from support.oracles.beams import middle_of_hit


def wrapped(angle):
    return (angle + math.pi) % (2 * math.pi) - math.pi


def beam_score(cells, resolution, x, y, amcl, reach):
    """What a beam that ends at x, y [m] adds to a particle's score: AMCL's likelihood fields."""
    row, col = math.floor(y / resolution), math.floor(x / resolution)
    distance = amcl.laser_likelihood_max_dist
    if 0 <= row < cells.shape[0] and 0 <= col < cells.shape[1]:
        for i, j in zip(*np.nonzero(cells == 0), strict=True):
            distance = min(distance, resolution * math.hypot(i - row, j - col))
    likelihood = amcl.z_hit * math.exp(-(distance**2) / (2 * amcl.sigma_hit**2))
    likelihood += amcl.z_rand / reach
    if amcl.laser_model_type == "likelihood_field_prob":
        return math.log(likelihood)
    return likelihood**3


def weigh(*about):
    """Weights of particles (3, n) after a scan whose beams end `ends` [cells] from the robot."""
    scaled = weights_of(*about)
    return scaled / scaled.sum()


def weights_of(cells, resolution, ends, poses, weights, amcl, reach):
    """The same, before they are scaled to add up to 1."""
    scaled = []
    for (x, y, heading), weight in zip(poses.T, weights, strict=True):
        score = 0.0
        for ahead, left in ends:
            if not math.isnan(ahead):
                end_x = x + resolution * (math.cos(heading) * ahead - math.sin(heading) * left)
                end_y = y + resolution * (math.sin(heading) * ahead + math.cos(heading) * left)
                aside = resolution / 2 if amcl.half_cell else 0.0
                score += beam_score(cells, resolution, end_x + aside, end_y + aside, amcl, reach)
        product = amcl.laser_model_type == "likelihood_field_prob"
        scaled.append(weight * (math.exp(score) if product else 1 + score))
    return np.array(scaled)


def move(random, poses, dx, dy, turn, heading, amcl):
    """sample_motion_odometry with AMCL's symmetry of forwards and backwards, or its omni model."""
    way = math.hypot(dx, dy)
    if amcl.robot_model_type == "nav2_amcl::OmniMotionModel":
        return glide(random, poses, way, math.atan2(dy, dx) - heading, turn, amcl)
    first = wrapped(math.atan2(dy, dx) - heading) if way >= 0.01 else 0.0
    second = wrapped(turn - first)
    sizes = [min(abs(a), abs(wrapped(a - math.pi))) for a in (first, second)]
    spreads = [math.sqrt(amcl.alpha1 * size**2 + amcl.alpha2 * way**2) for size in sizes]
    variance = amcl.alpha3 * way**2 + amcl.alpha4 * sizes[0] ** 2 + amcl.alpha4 * sizes[1] ** 2
    moved = []
    for x, y, facing in poses.T:
        own_first = first - spreads[0] * random.standard_normal()
        own_way = way - math.sqrt(variance) * random.standard_normal()
        own_second = second - spreads[1] * random.standard_normal()
        moved.append(
            (
                x + own_way * math.cos(facing + own_first),
                y + own_way * math.sin(facing + own_first),
                facing + own_first + own_second,
            )
        )
    return np.array(moved).T


def glide(random, poses, way, bearing, turn, amcl):
    """AMCL's omnidirectional model: noise along the way, of the turn, and to the side."""
    moved = []
    for x, y, facing in poses.T:
        along = (
            way
            + math.hypot(math.sqrt(amcl.alpha3) * way, math.sqrt(amcl.alpha4) * turn)
            * random.standard_normal()
        )
        own_turn = (
            turn
            + math.hypot(math.sqrt(amcl.alpha1) * turn, math.sqrt(amcl.alpha2) * way)
            * random.standard_normal()
        )
        aside = (
            math.hypot(math.sqrt(amcl.alpha4) * turn, math.sqrt(amcl.alpha5) * way)
            * random.standard_normal()
        )
        direction = facing + bearing
        moved.append(
            (
                x + along * math.cos(direction) + aside * math.sin(direction),
                y + along * math.sin(direction) - aside * math.cos(direction),
                facing + own_turn,
            )
        )
    return np.array(moved).T


def bins_of(poses):
    """The bin that each particle of (3, n) is in: 0.5 m, 0.5 m, 10 deg."""
    return [
        tuple(np.floor(np.array(pose) / (0.5, 0.5, math.pi / 18)).astype(int)) for pose in poses.T
    ]


def heaviest_cluster_mean(poses):
    """Mean of the largest group of particles whose bins touch."""
    bins = bins_of(poses)
    left, groups = set(bins), []
    while left:
        group = [left.pop()]
        for near in group:
            touching = {
                b for b in left if max(abs(p - q) for p, q in zip(b, near, strict=True)) <= 1
            }
            left -= touching
            group.extend(touching)
        groups.append([n for n, b in enumerate(bins) if b in group])
    x, y, heading = poses[:, max(groups, key=len)]
    return x.mean(), y.mean(), math.atan2(np.sin(heading).mean(), np.cos(heading).mean())


def kld_sample_size(bins, amcl):
    """Fox's bound on the number of particles, with AMCL's limits."""
    if bins <= 1:
        return amcl.max_particles
    share = 2 / (9 * (bins - 1))
    n = (bins - 1) / (2 * amcl.pf_err) * (1 - share + math.sqrt(share) * amcl.pf_z) ** 3
    return min(max(math.ceil(n), amcl.min_particles), amcl.max_particles)


def update_lost_share(averages, weight, amcl):
    """AMCL's share of random particles, after both averages have taken the mean weight."""
    if weight > 0:
        for n, alpha in enumerate((amcl.recovery_alpha_slow, amcl.recovery_alpha_fast)):
            averages[n] += (alpha if averages[n] else 1.0) * (weight - averages[n])
    return 0.0 if averages[0] == 0 else max(0.0, 1 - averages[1] / averages[0])


def resample(random, poses, weights, amcl, lost=0.0, free=(), resolution=1.0):
    """Particles drawn by their weights, or in free cells, until KLD sampling has enough."""
    drawn, bins = [], set()
    shares = np.cumsum(weights)
    while len(drawn) < amcl.max_particles:
        if lost > 0 and random.random() < lost:
            row, col = free[int(random.random() * len(free))]
            heading = math.pi * (2 * random.random() - 1)
            drawn.append(np.array([resolution * (col + 0.5), resolution * (row + 0.5), heading]))
        else:
            at = random.random() * shares[-1]
            drawn.append(poses[:, next(n for n, share in enumerate(shares) if share > at)])
        bins |= set(bins_of(drawn[-1][:, None]))
        if len(drawn) > kld_sample_size(len(bins), amcl):
            break
    return np.array(drawn).T


def measured_ends(random, cells, resolution, pose, sensor, angles, disturbances):
    """Ends of a real scan's beams, ahead and left of the robot [cells]."""
    row, col, heading = pose
    lever_x = (math.cos(heading) * sensor.mount_x - math.sin(heading) * sensor.mount_y) / resolution
    lever_y = (math.sin(heading) * sensor.mount_x + math.cos(heading) * sensor.mount_y) / resolution
    occluded = random.random() < disturbances.occlusion
    middle = angles[0] + random.random() * (angles[-1] - angles[0])
    before = (0.5 + 1.5 * random.random()) / resolution
    ends = []
    for angle in angles:
        noise, chance = random.standard_normal(), random.random()
        bearing = sensor.mount_yaw + angle
        at = middle_of_hit(
            cells, row + lever_y, col + lever_x, heading + bearing, sensor.range / resolution
        )
        at += noise * sensor.range_sigma / resolution
        if chance < disturbances.outliers:
            at = chance / disturbances.outliers * sensor.range / resolution
        if (
            occluded
            and abs(wrapped(angle - middle)) <= math.radians(disturbances.occlusion_deg) / 2
        ):
            at = min(at, before) if at == at else before
        ahead = sensor.mount_x / resolution + at * math.cos(bearing)
        left = sensor.mount_y / resolution + at * math.sin(bearing)
        returns = at > 0 and sensor.min_range / resolution <= at < sensor.range / resolution
        ends.append((ahead, left) if returns else (math.nan, math.nan))
    return np.array(ends)


def odometry_along(random, truth, odometry):
    """What odometry makes of a drive."""
    scale = 1 + odometry.distance_bias * random.standard_normal()
    bend = math.radians(odometry.heading_bias_deg) * random.standard_normal()
    turn_scale = 1 + odometry.turn_bias * random.standard_normal()
    told = [truth[0]]
    for before, after in itertools.pairwise(truth):
        way = math.dist(before[:2], after[:2])
        turn = wrapped(after[2] - before[2])
        aside = math.atan2(after[1] - before[1], after[0] - before[0]) - before[2] if way else 0.0
        own_way = scale * way + odometry.distance_drift * math.sqrt(way) * random.standard_normal()
        spread = math.hypot(
            math.radians(odometry.heading_drift_deg) * math.sqrt(way),
            math.radians(odometry.turn_drift_deg) * math.sqrt(abs(turn)),
        )
        x, y, heading = told[-1]
        own_turn = turn_scale * turn + bend * way + random.standard_normal() * spread
        told.append(
            (
                x + own_way * math.cos(heading + aside),
                y + own_way * math.sin(heading + aside),
                heading + own_turn,
            )
        )
    return np.array(told)


def drive(random, truth, cells, world, resolution, robot, angles, own=None, log=None):
    """How far AMCL's pose is off along a drive, (n, 3).

    The filter has random numbers of its own if `own` is given. What it gets is kept in `log`: the
    odometry, and the index of each update with the scan and the covariance of the particles.
    """
    sensor, amcl, disturbances = robot.lidar, robot.filter, robot.disturbances
    world_random, random = random, random if own is None else own
    told = odometry_along(world_random, truth, robot.odometry)
    log = [] if log is None else log
    log.append(told)
    spread = np.array(
        [
            disturbances.start_sigma,
            disturbances.start_sigma,
            math.radians(disturbances.start_sigma_deg),
        ]
    )
    guess = truth[0] + spread * random.standard_normal(3)
    poses = np.array(
        [guess + spread * random.standard_normal(3) for _ in range(amcl.max_particles)]
    ).T
    weights, averages = np.full(poses.shape[1], 1 / poses.shape[1]), [0.0, 0.0]
    pose, at, last, updates, errors = heaviest_cluster_mean(poses), 0, 0, 0, []
    for n, true in enumerate(truth):
        dx, dy, _ = told[n] - told[last]
        turn = wrapped(told[n][2] - told[last][2])
        far = max(abs(dx), abs(dy)) > amcl.update_min_d or abs(turn) > amcl.update_min_a
        if far:
            poses = move(random, poses, dx, dy, turn, told[last][2], amcl)
        if far or n == 0:
            sensed = true[1] / resolution, true[0] / resolution, true[2]
            ends = measured_ends(
                world_random, world, resolution, sensed, sensor, angles, disturbances
            )
            scaled = weights_of(cells, resolution, ends, poses, weights, amcl, sensor.range)
            lost = update_lost_share(averages, scaled.mean(), amcl)
            weights = scaled / scaled.sum()
            last, updates = n, updates + 1
            if updates % amcl.resample_interval == 0:
                free = np.argwhere(cells == 254).tolist()
                poses = resample(random, poses, weights, amcl, lost, free, resolution)
                averages = [0.0, 0.0] if lost else averages
                weights = np.full(poses.shape[1], 1 / poses.shape[1])
                pose, at = heaviest_cluster_mean(poses), n
            log.append((n, ends, covariance_of(poses)))
        turned = pose[2] - told[at][2]
        x, y, heading = told[n] - told[at]
        errors.append(
            (
                pose[0] + math.cos(turned) * x - math.sin(turned) * y - true[0],
                pose[1] + math.sin(turned) * x + math.cos(turned) * y - true[1],
                wrapped(pose[2] + heading - true[2]),
            )
        )
    return np.array(errors)


def covariance_of(poses):
    """Covariance of particles as AMCL publishes it."""
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = np.cov(poses[:2], bias=True)
    covariance[2, 2] = -2 * math.log(abs(np.exp(1j * poses[2]).mean()))
    return covariance
