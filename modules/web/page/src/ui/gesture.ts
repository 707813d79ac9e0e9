// For what is dragged by its own rule: no gesture of the browser's begins there. After a flick it would take the next tap,
// wherever that is, for the end of the flick.
export const ownGesture = (event: TouchEvent): void => event.preventDefault();
