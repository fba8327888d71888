#pragma once
// The only place that includes GL and EGL headers; included by .cpp files of render/gl alone.
#include <EGL/egl.h>
#include <EGL/eglext.h>
// gl31.h before the extensions, which use its types.
#include <GLES3/gl31.h>
//
#include <GLES2/gl2ext.h>
