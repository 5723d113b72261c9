/* The SG90, variant measured, by hand: servo_models/actuators/sg90 without effects.
 * The side of the motor's curve is looked up at each stage: its edges are 0, so that it is a straight
 * line and no jump has to be located. */

enum { /* value references, then what follows from the parameters */
    PULSE_WIDTH, LOAD_TORQUE, SUPPLY,
    ANGLE, RATE, FEEDBACK, MOTOR_VOLTAGE, MOTOR_SPEED, FLAG, ANGLE_READING, RATE_READING,
    INTERNAL_STEP, TIME_CONSTANT, STALL_TORQUE, STALL_VOLTAGE, NO_LOAD_SPEED, GEAR_RATIO,
    REFERENCE_VOLTAGE, FRAME_TIME, FEEDBACK_COEFFICIENT, POTENTIOMETER, ANGLE_UNIT, AMPLIFIER_GAIN,
    MOTOR_GAIN, ARMATURE_RESISTANCE, EDGE_POSITIVE, EDGE_NEGATIVE, ZERO_POSITIVE, ZERO_NEGATIVE,
    TOP_POSITIVE, TOP_NEGATIVE,
    VARIABLES, FIRST_OUTPUT = ANGLE,
    REST_ANGLE = VARIABLES, INERTIA, VOLTS_PER_LOAD, DAMPING, PLACES
};

static const double start[VARIABLES] = {
    0.0019, 0.0, 5.0,
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    0.002, 0.0347, 0.1765, 4.8, 245.28, 24.0,
    5.0, 0.02, 0.1, 1.4769578718927885, 1.0, 77.7,
    51.1, 7.0, 0.0, 0.0, 0.0, 0.0,
    0.0, 0.0,
};

typedef struct {
    double angle, speed;
} State;

static void prepare(double *p)
{
    p[REST_ANGLE] = p[REFERENCE_VOLTAGE] * 1.5e-3 / p[FRAME_TIME]
        / (p[FEEDBACK_COEFFICIENT] * p[POTENTIOMETER]);
    p[INERTIA] = p[TIME_CONSTANT] * p[STALL_TORQUE] / (p[NO_LOAD_SPEED] / p[GEAR_RATIO]);
    p[VOLTS_PER_LOAD] = p[STALL_VOLTAGE] / p[STALL_TORQUE];
    p[DAMPING] = p[STALL_TORQUE] / p[NO_LOAD_SPEED];
}

static inline double motor_voltage(const double *p, double angle)
{
    double command = p[REFERENCE_VOLTAGE] * p[PULSE_WIDTH] / p[FRAME_TIME];
    double feedback = p[POTENTIOMETER] * (angle + p[REST_ANGLE]);
    return p[AMPLIFIER_GAIN] * (command - p[FEEDBACK_COEFFICIENT] * feedback);
}

/* Speed of the motor at rest with its load, and whether that is its top. */
static inline double free_speed(const double *p, double angle, int *top)
{
    double volts = motor_voltage(p, angle) - p[VOLTS_PER_LOAD] * p[LOAD_TORQUE], speed = 0.0;
    *top = 0;
    if (volts > p[EDGE_POSITIVE]) {
        speed = p[MOTOR_GAIN] * (volts - p[ZERO_POSITIVE]);
        *top = 0.0 < p[TOP_POSITIVE] && p[TOP_POSITIVE] <= speed;
        return *top ? p[TOP_POSITIVE] : speed;
    }
    if (volts < -p[EDGE_NEGATIVE]) {
        speed = p[MOTOR_GAIN] * (volts + p[ZERO_NEGATIVE]);
        *top = 0.0 < p[TOP_NEGATIVE] && p[TOP_NEGATIVE] <= -speed;
        return *top ? -p[TOP_NEGATIVE] : speed;
    }
    return speed;
}

static inline State slopes(const double *p, double angle, double speed)
{
    int top;
    double lag = free_speed(p, angle, &top) - p[GEAR_RATIO] * speed;
    State s = {p[ANGLE_UNIT] * speed, p[DAMPING] * lag / p[INERTIA]};
    return s;
}

static inline State sub_step(const double *p, State x, double h)
{
    double half = 0.5 * h, sixth = h / 6.0;
    State k1 = slopes(p, x.angle, x.speed);
    State k2 = slopes(p, x.angle + half * k1.angle, x.speed + half * k1.speed);
    State k3 = slopes(p, x.angle + half * k2.angle, x.speed + half * k2.speed);
    State k4 = slopes(p, x.angle + h * k3.angle, x.speed + h * k3.speed);
    x.angle += sixth * (k1.angle + 2.0 * k2.angle + 2.0 * k3.angle + k4.angle);
    x.speed += sixth * (k1.speed + 2.0 * k2.speed + 2.0 * k3.speed + k4.speed);
    return x;
}

static inline void look(double *value, State x)
{
    int top;
    free_speed(value, x.angle, &top);
    value[ANGLE] = value[ANGLE_READING] = x.angle;
    value[RATE] = value[RATE_READING] = value[ANGLE_UNIT] * x.speed;
    value[FEEDBACK] = value[POTENTIOMETER] * (x.angle + value[REST_ANGLE]);
    value[MOTOR_VOLTAGE] = motor_voltage(value, x.angle);
    value[MOTOR_SPEED] = value[GEAR_RATIO] * x.speed;
    value[FLAG] = top || fabs(value[MOTOR_VOLTAGE]) >= fabs(value[SUPPLY]);
}
