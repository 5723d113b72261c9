/* The steps of an FMU over a table of rows, by calls of FMI 2.0 or 3.0: what host.py does in
   Python, where each call takes longer than the step. */
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#define WARNING 1 /* status; a higher one is a failed call */

typedef int (*Values2)(void *, const unsigned *, size_t, double *);
typedef int (*Values3)(void *, const unsigned *, size_t, double *, size_t);
typedef int (*Step2)(void *, double, double, int);
typedef int (*Step3)(void *, double, double, bool, bool *, bool *, bool *, double *);

/* What failed, 0 for nothing, with the status of the call or the time that was reached. */
enum { SET = 1, STEP, ENDS, EARLY, GET };

typedef struct {
  void *component, *set, *step, *get;
  int fmi3, failed, status;
  double reached;
} Fmu;

static int values(Fmu *fmu, void *call, const unsigned *references, size_t n, double *row) {
  if (n == 0)
    return 0;
  if (fmu->fmi3)
    fmu->status = ((Values3)call)(fmu->component, references, n, row, n);
  else
    fmu->status = ((Values2)call)(fmu->component, references, n, row);
  return fmu->status > WARNING;
}

static int step(Fmu *fmu, double time, double size) {
  bool event = false, ends = false, early = false;
  double off;
  if (!fmu->fmi3) {
    fmu->status = ((Step2)fmu->step)(fmu->component, time, size, 1);
    return fmu->status > WARNING ? STEP : 0;
  }
  fmu->reached = time + size;
  fmu->status = ((Step3)fmu->step)(fmu->component, time, size, true, &event, &ends, &early,
                                   &fmu->reached);
  if (fmu->status > WARNING || ends)
    return fmu->status > WARNING ? STEP : ENDS;
  off = (fmu->reached - time - size) / (1.0 + time + size);
  return off > 1e-9 || off < -1e-9 ? EARLY : 0;
}

/* Step from row 0, where the FMU is, with the inputs of each row until the next; outputs of the
   rows that follow.  Returns the row from which a step failed, or the last row. */
__attribute__((visibility("default"))) size_t
drive(Fmu *fmu, const unsigned *inputs, size_t n_inputs, const unsigned *outputs, size_t n_outputs,
      size_t rows, const double *times, double *given, double *out) {
  size_t k;
  for (k = 0; k + 1 < rows; k++) {
    double *row = given + k * n_inputs;
    bool held = k > 0 && memcmp(row, row - n_inputs, n_inputs * sizeof(double)) == 0;
    if (!held && values(fmu, fmu->set, inputs, n_inputs, row))
      fmu->failed = SET;
    else if (!(fmu->failed = step(fmu, times[k], times[k + 1] - times[k])) &&
             values(fmu, fmu->get, outputs, n_outputs, out + k * n_outputs))
      fmu->failed = GET;
    if (fmu->failed)
      break;
  }
  return k;
}
