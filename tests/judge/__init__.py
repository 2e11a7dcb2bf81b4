"""An independent simulator to judge the diagnosis by; it shares no equation with symbolic/, codegen/ or runtime/."""
