/* The torque motor by hand: servo_models/actuators/torque_motor without effects.
 * The divisions are those of the equations: with reciprocals the results would differ. */

enum { /* value references */
    VOLTAGE, LOAD_TORQUE,
    ANGLE, RATE, CURRENT, MOTOR_TORQUE, FLAG,
    INTERNAL_STEP, INERTIA, INDUCTANCE, BACK_EMF, RESISTANCE, TORQUE_CONSTANT, STIFFNESS, FRICTION,
    VARIABLES, FIRST_OUTPUT = ANGLE, PLACES = VARIABLES
};

static const double start[VARIABLES] = {
    30.0, 0.0,
    0.0, 0.0, 0.0, 0.0, 0.0,
    1e-4, 7.246e-07, 29.865952092984383, 0.07921254844240272, 3630.0, 5.227568288241415, 1.1,
    0.0002684330794891636,
};

typedef struct {
    double current, angle, speed;
} State;

static void prepare(double *p) { (void)p; }

static inline State slopes(const double *p, double current, double angle, double speed)
{
    double torque = p[TORQUE_CONSTANT] * current - p[STIFFNESS] * angle - p[FRICTION] * speed
        - p[LOAD_TORQUE];
    State s = {
        (p[VOLTAGE] - p[RESISTANCE] * current - p[BACK_EMF] * speed) / p[INDUCTANCE],
        speed,
        torque / p[INERTIA],
    };
    return s;
}

static inline State sub_step(const double *p, State x, double h)
{
    double half = 0.5 * h, sixth = h / 6.0;
    State k1 = slopes(p, x.current, x.angle, x.speed);
    State k2 = slopes(p, x.current + half * k1.current, x.angle + half * k1.angle,
        x.speed + half * k1.speed);
    State k3 = slopes(p, x.current + half * k2.current, x.angle + half * k2.angle,
        x.speed + half * k2.speed);
    State k4 = slopes(p, x.current + h * k3.current, x.angle + h * k3.angle,
        x.speed + h * k3.speed);
    x.current += sixth * (k1.current + 2.0 * k2.current + 2.0 * k3.current + k4.current);
    x.angle += sixth * (k1.angle + 2.0 * k2.angle + 2.0 * k3.angle + k4.angle);
    x.speed += sixth * (k1.speed + 2.0 * k2.speed + 2.0 * k3.speed + k4.speed);
    return x;
}

static inline void look(double *value, State x)
{
    value[ANGLE] = x.angle;
    value[RATE] = x.speed;
    value[CURRENT] = x.current;
    value[MOTOR_TORQUE] = value[TORQUE_CONSTANT] * x.current;
    value[FLAG] = 0.0; /* without stops it rests on none */
}
