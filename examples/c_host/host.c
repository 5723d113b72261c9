/* Step an FMU (FMI 2.0 co-simulation) and print its outputs as CSV: times in s, values in SI. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "fmi2FunctionTypes.h"
#ifdef _WIN32
#include <windows.h>
#define dlopen(path, how) ((void *)LoadLibraryA(path))
#define dlsym(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#else
#include <dlfcn.h>
#endif
#define NEED(ok, told) do if (!(ok)) { fprintf(stderr, "host: %s\n", told); exit(1); } while (0)
#define CALL(call) NEED((call) <= fmi2Warning, "failed: " #call)
#define LOAD(f) fmi2##f##TYPE *f = (fmi2##f##TYPE *)dlsym(library, "fmi2" #f); NEED(f, "no fmi2" #f)
static char xml[1 << 21]; /* modelDescription.xml, and zeros behind it */

static char *attribute(const char *element, const char *key, char text[256]) { /* "": not there */
    const char *at = strstr(element, key), *end = strchr(element + 1, '<');
    if (!at || at > end || sscanf(at + strlen(key), "%255[^\"]", text) != 1) *text = '\0';
    return text;
}
static void logger(void *env, fmi2String who, fmi2Status is, fmi2String of, fmi2String text, ...) {
    va_list values; va_start(values, text); vfprintf(stderr, text, values); va_end(values);
    fprintf(stderr, " (%s, category %s, status %d)\n", who, of, is), (void)env;
}
int main(int count, char **words) {
    NEED(count > 4, "give it modelDescription.xml LIBRARY STOP STEP [NAME=START ...]");
    FILE *file = fopen(words[1], "rb"); void *library = dlopen(words[2], RTLD_NOW);
    NEED(file && fread(xml, 1, sizeof xml - 1, file), "cannot read modelDescription.xml");
    NEED(library, "cannot load LIBRARY"); LOAD(Instantiate); LOAD(SetupExperiment);
    LOAD(EnterInitializationMode); LOAD(ExitInitializationMode); LOAD(SetReal); LOAD(GetReal);
    LOAD(GetBoolean); LOAD(DoStep); LOAD(Terminate); LOAD(FreeInstance);
    double stop = atof(words[3]), step = atof(words[4]), value; char name[256], text[256], *at;
    fmi2ValueReference vr, out[500]; fmi2Boolean flag, is_flag[500]; int n = 0, set = 0;
    NEED((at = strstr(xml, "<fmiModelDescription")) && step > 0.0, "no description, or no STEP");
    fmi2CallbackFunctions cb = {logger, calloc, free, NULL, NULL}; attribute(at, " guid=\"", text);
    fmi2Component fmu = Instantiate("host", fmi2CoSimulation, text, "", &cb, fmi2False, fmi2True);
    NEED(fmu, "the FMU refuses to be instantiated");
    CALL(SetupExperiment(fmu, fmi2False, 0.0, 0.0, fmi2True, stop));
    CALL(EnterInitializationMode(fmu)); printf("time");
    while ((at = strstr(at + 1, "<ScalarVariable "))) {
        attribute(at, " name=\"", name), vr = atoi(attribute(at, " valueReference=\"", text));
        if (n < 500 && !strcmp(attribute(at, " causality=\"", text), "output"))
            printf(",%s", name), is_flag[n] = !strncmp(strchr(at + 1, '<'), "<B", 2), out[n++] = vr;
        for (int i = 5; i < count; i++)
            if (sscanf(words[i], "%255[^=]=%lf", text, &value) == 2 && !strcmp(text, name) && ++set)
                CALL(SetReal(fmu, &vr, 1, &value));
    }
    NEED(set == count - 5, "a NAME=START names no variable"); CALL(ExitInitializationMode(fmu));
    for (long k = 0; k * step <= stop * (1.0 + 1e-9); k++) {
        if (k > 0) CALL(DoStep(fmu, (k - 1) * step, k * step - (k - 1) * step, fmi2True));
        printf("\n%.17g", k * step);
        for (int i = 0; i < n; i++, printf(",%.17g", value))
            if (!is_flag[i]) CALL(GetReal(fmu, &out[i], 1, &value));
            else { CALL(GetBoolean(fmu, &out[i], 1, &flag)); value = flag; }
    }
    CALL(Terminate(fmu)); FreeInstance(fmu); puts("");
}
