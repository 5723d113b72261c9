/* Every function of an FMI 2.0 co-simulation library, loaded at run time (POSIX). */
#ifndef FMI2_LIBRARY_H
#define FMI2_LIBRARY_H

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2FunctionTypes.h"

#define FMI2_FUNCTIONS(F)                                                                     \
    F(GetTypesPlatform) F(GetVersion) F(SetDebugLogging) F(Instantiate) F(FreeInstance)       \
    F(SetupExperiment) F(EnterInitializationMode) F(ExitInitializationMode) F(Terminate)      \
    F(Reset) F(GetReal) F(GetInteger) F(GetBoolean) F(GetString) F(SetReal) F(SetInteger)     \
    F(SetBoolean) F(SetString) F(GetFMUstate) F(SetFMUstate) F(FreeFMUstate)                  \
    F(SerializedFMUstateSize) F(SerializeFMUstate) F(DeSerializeFMUstate)                     \
    F(GetDirectionalDerivative) F(SetRealInputDerivatives) F(GetRealOutputDerivatives)        \
    F(DoStep) F(CancelStep) F(GetStatus) F(GetRealStatus) F(GetIntegerStatus)                 \
    F(GetBooleanStatus) F(GetStringStatus)

#define FMI2_MEMBER(name) fmi2##name##TYPE *name;
typedef struct {
    FMI2_FUNCTIONS(FMI2_MEMBER)
} fmi2_library;

/* Load a library, or say what is missing and exit with 2. */
static fmi2_library load_library(const char *path)
{
    fmi2_library found;
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        fprintf(stderr, "cannot load the library: %s\n", dlerror());
        exit(2);
    }
#define FMI2_FIND(name)                                                      \
    if (!(found.name = (fmi2##name##TYPE *)dlsym(library, "fmi2" #name))) { \
        fprintf(stderr, "'%s' has no fmi2" #name "\n", path);               \
        exit(2);                                                             \
    }
    FMI2_FUNCTIONS(FMI2_FIND)
    return found;
}

#endif
