/PROG  VGRD_GO
/ATTR
OWNER           = MNEDITOR;
COMMENT         = "vgrd: go to EC";
PROG_SIZE       = 0;
CREATE          = DATE 26-11-27  TIME 08:00:00;
MODIFIED        = DATE 26-11-27  TIME 08:00:00;
FILE_NAME       = ;
VERSION         = 0;
LINE_COUNT      = 0;
MEMORY_SIZE     = 0;
PROTECT         = READ_WRITE;
TCD:  STACK_SIZE        = 0,
      TASK_PRIORITY     = 50,
      TIME_SLICE        = 0,
      BUSY_LAMP_OFF     = 0,
      ABORT_REQUEST     = 0,
      PAUSE_REQUEST     = 0;
DEFAULT_GROUP   = 1,*,*,*,*;
CONTROL_CODE    = 00000000 00000000;
/MN
   1:  !FRAGMENT, not run on hardware ;
   2:  !VGRD decides, this moves ;
   3:  !not a safety function ;
   4:  !before: R[82] point, ;
   5:  !PR[81] taught touch pose, ;
   6:  !PR[83] clear pose before it ;
   7:  UFRAME_NUM=0 ;
   8:  UTOOL_NUM=10 ;
   9:  LBL[1:ANEW] ;
  10:  R[88:TRY]=0 ;
  11:  LBL[2:ATTEMPT] ;
  12:  R[88:TRY]=R[88:TRY]+1 ;
  13:J PR[83:CLEAR] 20% FINE ;
  14:  !first answer ;
  15:  R[89:MODE]=1 ;
  16:  R[81:ASK]=R[81:ASK]+1 ;
  17:  $WAITTMOUT=600 ;
  18:  WAIT R[83:DONE]=R[81:ASK] TIMEOUT,LBL[91] ;
  19:  IF R[84:WORD]<>0,JMP LBL[90] ;
  20:  !to the approach point ;
  21:  R[90:BEAT]=R[87:TASK] ;
  22:  $WAITTMOUT=50 ;
  23:  WAIT R[87:TASK]<>R[90:BEAT] TIMEOUT,LBL[91] ;
  24:  SKIP CONDITION F[80:VALID]=OFF ;
  25:L PR[82:APPROACH] 100mm/sec FINE Skip,LBL[10] ;
  26:  JMP LBL[92] ;
  27:  LBL[10:THERE] ;
  28:  !second answer ;
  29:  R[89:MODE]=2 ;
  30:  R[81:ASK]=R[81:ASK]+1 ;
  31:  $WAITTMOUT=600 ;
  32:  WAIT R[83:DONE]=R[81:ASK] TIMEOUT,LBL[91] ;
  33:  IF R[84:WORD]<>0,JMP LBL[90] ;
  34:  !last leg ;
  35:  R[90:BEAT]=R[87:TASK] ;
  36:  $WAITTMOUT=50 ;
  37:  WAIT R[87:TASK]<>R[90:BEAT] TIMEOUT,LBL[91] ;
  38:  SKIP CONDITION F[80:VALID]=OFF ;
  39:L PR[80:TARGET] 50mm/sec FINE Skip,LBL[99] ;
  40:  !lost: back as it came ;
  41:L PR[82:APPROACH] 50mm/sec FINE ;
  42:  JMP LBL[92] ;
  43:  LBL[90:REFUSED] ;
  44:  IF R[85:AGAIN]=0,JMP LBL[93] ;
  45:  IF R[88:TRY]>=3,JMP LBL[93] ;
  46:  WAIT    .50(sec) ;
  47:  JMP LBL[2] ;
  48:  LBL[91:LINK] ;
  49:  R[84:WORD]=1 ;
  50:  JMP LBL[93] ;
  51:  LBL[92:POLL] ;
  52:  R[84:WORD]=18 ;
  53:  LBL[93:STOP] ;
  54:  !R[84] decision, R[86] STATUS ;
  55:  MESSAGE[vgrd: see R84 and R86] ;
  56:  PAUSE ;
  57:  JMP LBL[1] ;
  58:  LBL[99:END] ;
/POS
/END
